// Fuzzes scans that are read in pieces and whole, under the name PALPATE_FUZZ_NAME: both give the same points
// or both an Error, in bounded memory. E57 pages get right checksums first, or nothing behind them is
// reached.
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "tests/fuzz/must.h"
#include "tests/toolkit/io/e57_writer.h"
#include "toolkit/io/read_e57.h"
#include "toolkit/io/read_ptx.h"

namespace {

using namespace palpate::io;
using palpate::must;
using palpate::Result;
using palpate::Vec3;

constexpr std::string_view kName = PALPATE_FUZZ_NAME;
constexpr bool kE57 = kName.ends_with(".e57"), kPtx = kName.ends_with(".ptx");
static_assert(kE57 || kPtx || kName.ends_with(".pts"));

Result<std::unique_ptr<PointStream>> open(std::unique_ptr<RandomAccess> file, const std::string& name) {
  return kE57   ? e57_stream(std::move(file), name)
         : kPtx ? ptx_stream(std::move(file), name)
                : pts_stream(std::move(file), name);
}
Result<DecodedFile> read(const ReaderInput& input) {
  return kE57 ? read_e57(input) : kPtx ? read_ptx(input) : read_pts(input);
}

// NaN is nobody's equal, so bits are compared.
bool same(const Vec3& a, const Vec3& b) {
  for (int axis = 0; axis < 3; ++axis)
    if (std::bit_cast<std::uint64_t>(a[axis]) != std::bit_cast<std::uint64_t>(b[axis])) return false;
  return true;
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  std::string file(reinterpret_cast<const char*>(data), size);
  if (kE57) E57TestFile::seal(file);
  const auto bytes = std::as_bytes(std::span(file));
  const std::string name(kName);
  MemorySource source(bytes);
  ReadOptions options;
  // Above what an input of some KB can hold: a record has one bit at least, and takes 48 bytes at most.
  options.max_bytes = std::uint64_t{16} << 20;
  const Result<DecodedFile> whole = read(ReaderInput{source, name, options, palpate::no_progress()});
  must(whole.ok() || !whole.error().what.empty());
  if (whole) {
    for (const auto& property : whole->properties) must(property.values.size() == whole->points.size());
    must(whole->position_of.empty() || whole->position_of.size() == whole->points.size());
    if (whole->raster)
      must(std::size_t{whole->raster->columns} * whole->raster->rows == whole->points.size());
  }
  // What only bears the name is read as columns of text.
  if (!kE57 && !kPtx && !starts_as_pts(std::string_view(file).substr(0, kScanTextFrontBytes))) return 0;
  auto stream = open(std::make_unique<MemoryAccess>(bytes), name);
  if (!stream) {
    // A promise beyond the bound of memory is refused by who needs the whole.
    must(!whole && stream.error().file == name);
    return 0;
  }
  constexpr std::size_t kPiece = 100;
  std::vector<Vec3> piece(kPiece);
  std::size_t at = 0;
  while (true) {
    const Result<std::size_t> n = (*stream)->read(piece);
    if (!n) {
      must(!whole && n.error().file == name);
      return 0;
    }
    if (*n == 0) break;
    for (std::size_t i = 0; whole && i < *n; ++i) must(same(piece[i], whole->points.at(at + i)));
    at += *n;
  }
  must(!whole || at == whole->points.size());
  return 0;
}
