#include "toolkit/io/decoding.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <limits>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "toolkit/core/bytes.h"
#include "toolkit/core/csv_dialect.h"
#include "toolkit/core/messages.h"
#include "toolkit/geometry/triangle_meshes.h"

namespace palpate::io {
namespace {

// A binary file: a comment, the count, then for each facet a normal and three corners as floats and two bytes
// that nobody agrees on.
constexpr std::size_t kStlCommentBytes = 80;
constexpr std::size_t kStlHeadBytes = kStlCommentBytes + sizeof(std::uint32_t);
constexpr std::size_t kStlVectorBytes = 3 * sizeof(float);
constexpr std::size_t kStlFacetBytes = 4 * kStlVectorBytes + sizeof(std::uint16_t);
constexpr std::size_t kStlCorners = 3;
// Bytes of a facet until equal corners are merged: its corners, their order for sorting and numbers, itself.
constexpr std::uint64_t kBytesPerFacet =
    kStlCorners * (2 * sizeof(Vec3) + 3 * sizeof(std::uint32_t)) + 2 * sizeof(std::array<std::uint32_t, 3>);
constexpr const char* kFetchStl = "the file is cut off: fetch it again";

class FacetTaker {
 public:
  FacetTaker(const ReaderInput& input, std::uint64_t file_bytes)
      : input_(input), most_(most_facets(input.options, file_bytes)) {}

  Status take(const std::array<Vec3, kStlCorners>& corners) {
    if (++facets_ % kRowsPerReport == 0) {
      input_.progress.report("reading", done_);
      if (input_.progress.cancelled()) return Error{"reading was stopped"};
    }
    if (!std::all_of(corners.begin(), corners.end(), [](const Vec3& p) { return is_finite(p); })) {
      ++dropped_;
      return Done{};
    }
    if (facets_ > most_) return over_memory_limit("the file's facets", input_.options.max_bytes);
    const auto first = static_cast<std::uint32_t>(mesh_.vertices_mm.size());
    mesh_.triangles.push_back({first, first + 1, first + 2});
    mesh_.vertices_mm.insert(mesh_.vertices_mm.end(), corners.begin(), corners.end());
    return Done{};
  }
  void reserve(std::size_t facets) {
    mesh_.triangles.reserve(facets);
    mesh_.vertices_mm.reserve(kStlCorners * facets);
  }
  void set_done(double fraction) noexcept { done_ = fraction; }
  [[nodiscard]] std::uint64_t facets() const noexcept { return facets_; }
  [[nodiscard]] std::uint64_t most() const noexcept { return most_; }

  // The mesh with equal corners made one.
  void finish(DecodedFile& decoded) {
    geometry::TriangleMesh one = geometry::welded(mesh_);
    decoded.dropped_faces = dropped_ + (mesh_.triangles.size() - one.triangles.size());
    decoded.points = std::move(one.vertices_mm);
    decoded.triangles = std::move(one.triangles);
    decoded.continues_face.assign(decoded.triangles.size(), false);
  }

 private:
  // By the memory that is left beside the file's own bytes, and by indices of 32 bits.
  static std::uint64_t most_facets(const ReadOptions& options, std::uint64_t file_bytes) noexcept {
    const std::uint64_t left = options.max_bytes > file_bytes ? options.max_bytes - file_bytes : 0;
    return std::min(left / kBytesPerFacet, kMaxPoints / kStlCorners);
  }

  const ReaderInput& input_;
  std::uint64_t most_;
  std::uint64_t facets_ = 0;
  std::size_t dropped_ = 0;
  double done_ = 0.0;
  geometry::TriangleMesh mesh_;  // in the file's unit, three corners for each facet
};

std::uint32_t facets_promised(std::span<const std::byte> file) {
  ByteReader head(file.subspan(kStlCommentBytes));
  return head.u32();
}

std::uint64_t binary_bytes(std::uint32_t facets) noexcept {
  return kStlHeadBytes + std::uint64_t{facets} * kStlFacetBytes;
}

// Whether the file is text: it does not have the size that its count as a binary file asks for, begins with
// "solid", and its front names a facet or the end.
bool is_text(std::span<const std::byte> file) {
  if (file.size() >= kStlHeadBytes && file.size() == binary_bytes(facets_promised(file))) return false;
  // A name of some length may follow "solid"; a comment of a binary file ends before.
  constexpr std::size_t kFront = 1024;
  const std::string front =
      lower_case(std::string_view(reinterpret_cast<const char*>(file.data()), std::min(file.size(), kFront)));
  const std::string_view words = trimmed(front);
  return words.starts_with("solid") &&
         (file.size() < kStlHeadBytes || words.find("facet") != std::string_view::npos ||
          words.find("endsolid") != std::string_view::npos);
}

Status read_binary(std::span<const std::byte> file, FacetTaker& facets, DecodedFile& decoded) {
  decoded.format = "STL, binary";
  decoded.single_precision = true;
  if (file.size() < kStlHeadBytes)
    return Error{
        fmt::format("the file has {} bytes: neither \"solid\" nor the {} bytes before the facets of a "
                    "binary STL file",
                    file.size(), kStlHeadBytes),
        kFetchStl};
  const std::uint32_t promised = facets_promised(file);
  if (binary_bytes(promised) > file.size())
    return Error{fmt::format("the header promises {} facets, {} fit the file's {} bytes", promised,
                             (file.size() - kStlHeadBytes) / kStlFacetBytes, file.size()),
                 kFetchStl};
  if (binary_bytes(promised) < file.size())
    decoded.warnings.push_back(fmt::format("{} bytes follow the last facet; they were passed over.",
                                           file.size() - binary_bytes(promised)));
  facets.reserve(static_cast<std::size_t>(std::min<std::uint64_t>(promised, facets.most())));
  ByteReader bytes(file.subspan(kStlHeadBytes));
  for (std::uint32_t f = 0; f < promised; ++f) {
    (void)bytes.raw(kStlVectorBytes);  // the normal, which the corners tell too
    std::array<Vec3, kStlCorners> corners;
    for (Vec3& corner : corners)
      for (int axis = 0; axis < 3; ++axis) corner[axis] = static_cast<double>(bytes.single());
    (void)bytes.u16();
    facets.set_done(static_cast<double>(f) / static_cast<double>(promised));
    PALPATE_TRY(facets.take(corners));
  }
  return Done{};
}

// "vertex x y z" three times between "facet" and "endfacet". Whatever stands around them (names, "outer
// loop") changes nothing. A file may hold several solids.
Status read_text(std::span<const std::byte> file, FacetTaker& facets, DecodedFile& decoded) {
  decoded.format = "STL, ASCII";
  MemorySource source(file);
  BufferedInput in(source);
  std::string_view line;
  std::array<Vec3, kStlCorners> corners;
  bool open = false;     // a facet
  std::size_t have = 0;  // its corners
  bool ended = false;
  const auto at_line = [&](std::string what, std::string remedy = kCheckLine) {
    return in.error_or({std::move(what), std::move(remedy)});
  };
  while (in.next_line(line)) {
    const std::string word = lower_case(next_token(line));
    if (word.empty()) continue;
    ended = word == "endsolid";
    if (word == "facet") {
      if (open) return at_line("a facet begins within another");
      open = true;
      have = 0;
    } else if (word == "vertex") {
      if (!open) return at_line("a vertex stands outside of a facet");
      if (have == kStlCorners) return at_line("a facet has more than three corners");
      const Result<Vec3> corner = next_vertex(line);
      if (!corner) return at_line(corner.error().what, corner.error().remedy);
      corners[have++] = *corner;
    } else if (word == "endfacet") {
      if (!open) return at_line("a facet ends that has not begun");
      if (have != kStlCorners) return at_line(fmt::format("a facet has {} corners instead of three", have));
      open = false;
      facets.set_done(in.fraction());
      PALPATE_TRY(facets.take(corners));
    } else if (word != "solid" && word != "outer" && word != "endloop" && word != "endsolid") {
      return at_line(fmt::format("the word {} is not understood in an STL file", shown(word)));
    }
  }
  if (in.error()) return *in.error();
  if (open) return at_line("the file ends within a facet", kFetchStl);
  if (!ended)
    return at_line(fmt::format("the file ends after {} facets without \"endsolid\"", facets.facets()),
                   kFetchStl);
  return Done{};
}

}  // namespace

Result<DecodedFile> read_stl(const ReaderInput& input) {
  PALPATE_ASSIGN(const std::vector<std::byte> bytes, read_all(input.bytes, input.options.max_bytes));
  DecodedFile decoded;
  FacetTaker facets(input, bytes.size());
  PALPATE_TRY(is_text(bytes) ? read_text(bytes, facets, decoded) : read_binary(bytes, facets, decoded));
  if (facets.facets() == 0) return Error{"the file holds no facets", "give an STL file with triangles"};
  facets.finish(decoded);
  return decoded;
}

}  // namespace palpate::io
