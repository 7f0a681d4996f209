#include "toolkit/prepared/cell_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <new>
#include <string_view>

#include "toolkit/core/hash.h"
#include "toolkit/io/decoding.h"

namespace palpate::prepared {
namespace {

constexpr std::string_view kCellFileMagic = "PALCELLS";
constexpr const char* kMakeAgain = "prepare the points again";
/// The header's hash stands in its last eight bytes.
constexpr std::size_t kHashedHeaderBytes = kCellHeaderBytes - sizeof(std::uint64_t);

std::uint64_t hash_of(std::span<const std::byte> bytes) noexcept {
  Hash64 hash;
  hash.bytes(bytes);
  return hash.value();
}

Vec3 real(const LatticePoint& p) noexcept {
  return {static_cast<double>(p[0]), static_cast<double>(p[1]), static_cast<double>(p[2])};
}

/// The box in whole quanta, because points are read at the middle of theirs.
geometry::Aabb box_of(const CellLattice& lattice, const CellEntry& entry) noexcept {
  LatticePoint low{}, past{};
  for (std::size_t axis = 0; axis < 3; ++axis) {
    low[axis] = entry.low[axis] >> entry.shift << entry.shift;
    past[axis] = ((entry.high[axis] >> entry.shift) + 1) << entry.shift;
  }
  return {lattice.place_mm(real(low)), lattice.place_mm(real(past))};
}

}  // namespace

void write_cell_entry(ByteWriter& writer, const CellEntry& entry) noexcept {
  writer.u64(entry.key.high);
  writer.u64(entry.key.low);
  writer.u8(entry.depth);
  writer.u8(entry.shift);
  writer.u16(0);
  writer.u32(entry.points);
  writer.u32(entry.halo);
  writer.u32(0);
  writer.u64(entry.offset);
  for (const LatticePoint* p : {&entry.low, &entry.high, &entry.base})
    for (const std::uint64_t c : *p) writer.u64(c);
  writer.real(entry.halo_mm);
  writer.u64(entry.hash);
}

CellEntry read_cell_entry(ByteReader& reader) noexcept {
  CellEntry entry;
  entry.key.high = reader.u64();
  entry.key.low = reader.u64();
  entry.depth = reader.u8();
  entry.shift = reader.u8();
  (void)reader.u16();
  entry.points = reader.u32();
  entry.halo = reader.u32();
  (void)reader.u32();
  entry.offset = reader.u64();
  for (LatticePoint* p : {&entry.low, &entry.high, &entry.base})
    for (std::uint64_t& c : *p) c = reader.u64();
  entry.halo_mm = reader.real();
  entry.hash = reader.u64();
  return entry;
}

std::vector<std::byte> encode_cell_header(const CellFileInfo& info, std::uint64_t table_offset,
                                          std::uint64_t table_hash) {
  std::vector<std::byte> bytes(kCellHeaderBytes, std::byte{0});
  ByteWriter writer{std::span(bytes)};
  writer.raw(std::as_bytes(std::span(kCellFileMagic)));
  writer.u32(kCellFileVersion);
  writer.u32(static_cast<std::uint32_t>(kCellHeaderBytes));
  for (const std::uint64_t number :
       {info.points, info.dropped, info.halo_points, info.cells, table_offset, table_hash})
    writer.u64(number);
  writer.i64(info.lattice.unit_exponent);
  for (const double first : info.lattice.first) writer.real(first);
  writer.vec(info.bounds_mm.low_mm);
  writer.vec(info.bounds_mm.high_mm);
  for (const double number : {info.asked_quantum_mm, info.quantum_mm, info.halo_spacings, info.mm_per_unit})
    writer.real(number);
  ByteWriter end{std::span(bytes).subspan(kHashedHeaderBytes)};
  end.u64(hash_of(std::span(bytes).first(kHashedHeaderBytes)));
  return bytes;
}

Error CellFile::damaged(const std::string& what) const {
  return Error{what, kMakeAgain, file_.path()};
}

Status CellFile::read_header(std::uint64_t& table_offset, std::uint64_t& table_hash) {
  std::array<std::byte, kCellHeaderBytes> bytes{};
  if (file_.size() < bytes.size()) return damaged("this is no file of prepared cells: it is too short");
  PALPATE_TRY(file_.read_at(0, bytes));
  ByteReader reader{std::span<const std::byte>(bytes)};
  const auto magic = reader.raw(kCellFileMagic.size());
  if (!std::ranges::equal(magic, std::as_bytes(std::span(kCellFileMagic))))
    return damaged("this is no file of prepared cells");
  const std::uint32_t version = reader.u32();
  if (version != kCellFileVersion)
    return damaged(fmt::format("the prepared cells have version {}, this program reads version {}", version,
                               kCellFileVersion));
  ByteReader end{std::span<const std::byte>(bytes).subspan(kHashedHeaderBytes)};
  if (end.u64() != hash_of(std::span(bytes).first(kHashedHeaderBytes)) || reader.u32() != kCellHeaderBytes)
    return damaged("the header of the prepared cells is damaged");
  info_.points = reader.u64();
  info_.dropped = reader.u64();
  info_.halo_points = reader.u64();
  info_.cells = reader.u64();
  table_offset = reader.u64();
  table_hash = reader.u64();
  const std::int64_t exponent = reader.i64();
  for (double& first : info_.lattice.first) first = reader.real();
  info_.bounds_mm.low_mm = reader.vec();
  info_.bounds_mm.high_mm = reader.vec();
  for (double* number :
       {&info_.asked_quantum_mm, &info_.quantum_mm, &info_.halo_spacings, &info_.mm_per_unit})
    *number = reader.real();
  // A lattice wider than doubles reach gives places that are not finite.
  constexpr std::int64_t kMostExponent = 900;
  constexpr double kMostFirst = 1e30;  // 2^99; 2^46 steps of 2^36 cubes are 2^82
  bool fits = exponent >= -kMostExponent && exponent <= kMostExponent;
  for (const double first : info_.lattice.first) fits = fits && std::abs(first) <= kMostFirst;
  if (!fits) return damaged("the prepared cells have a lattice that is none");
  info_.lattice.unit_exponent = static_cast<int>(exponent);
  // Compared without a product or sum that could wrap.
  if (table_offset < kCellHeaderBytes || table_offset > file_.size() ||
      (file_.size() - table_offset) % kCellEntryBytes != 0 ||
      (file_.size() - table_offset) / kCellEntryBytes != info_.cells)
    return Error{
        fmt::format("{} cells are promised, {} bytes do not hold just them", info_.cells, file_.size()),
        "the file is cut short or damaged: copy it again, or prepare the points again", file_.path()};
  return Done{};
}

Status CellFile::check_entry(std::size_t cell, std::uint64_t offset) const {
  const CellEntry& entry = entries_[cell];
  bool good = entry.offset == offset && entry.depth <= kKeyBits && entry.shift <= kAxisBits &&
              entry.points >= 1 && entry.points <= kMostCellPoints && entry.halo <= kMostHaloPoints &&
              entry.halo_mm >= 0.0 && std::isfinite(entry.halo_mm);
  // Only cells of equal points have one key.
  good = good && (cell == 0 || entries_[cell - 1].key < entry.key ||
                  (entries_[cell - 1].key == entry.key && entry.depth == kKeyBits));
  for (std::size_t axis = 0; good && axis < 3; ++axis) {
    constexpr std::uint64_t kCubes = std::uint64_t{1} << kAxisBits;
    good = entry.low[axis] <= entry.high[axis] && entry.high[axis] < kCubes &&
           entry.base[axis] <= entry.low[axis] >> entry.shift &&
           (entry.high[axis] >> entry.shift) - entry.base[axis] <= kMostSteps;
  }
  if (good) return Done{};
  return damaged(fmt::format("the table's line of cell {} is impossible", cell));
}

Status CellFile::read_table(std::uint64_t table_offset, std::uint64_t table_hash) {
  // The header was compared with the file's size, so this is no more than the file.
  std::vector<std::byte> bytes(static_cast<std::size_t>(file_.size() - table_offset));
  PALPATE_TRY(file_.read_at(table_offset, bytes));
  if (hash_of(bytes) != table_hash) return damaged("the table of the prepared cells is damaged");
  ByteReader reader{std::span<const std::byte>(bytes)};
  entries_.resize(static_cast<std::size_t>(info_.cells));
  std::uint64_t offset = kCellHeaderBytes, points = 0, halo = 0;
  for (std::size_t cell = 0; cell < entries_.size(); ++cell) {
    CellEntry& entry = entries_[cell] = read_cell_entry(reader);
    PALPATE_TRY(check_entry(cell, offset));
    offset += entry.bytes();
    points += entry.points;
    halo += entry.halo;
  }
  if (offset != table_offset || points != info_.points || halo != info_.halo_points)
    return damaged("the table of the prepared cells does not agree with the header");
  return Done{};
}

bool CellFile::begins_as_one(std::span<const std::byte> first_bytes) noexcept {
  const auto magic = std::as_bytes(std::span(kCellFileMagic));
  return first_bytes.size() >= magic.size() && std::ranges::equal(first_bytes.first(magic.size()), magic);
}

Result<CellFile> CellFile::open(const std::string& path) {
  PALPATE_ASSIGN(InputFile input, InputFile::open(path));
  CellFile file(std::move(input));
  std::uint64_t table_offset = 0, table_hash = 0;
  PALPATE_TRY(file.read_header(table_offset, table_hash));
  PALPATE_TRY(file.read_table(table_offset, table_hash));
  return file;
}

double CellFile::halo_bytes_per_point() const noexcept {
  if (info_.points == 0) return 0.0;
  return static_cast<double>(info_.halo_points * kBytesPerPoint) / static_cast<double>(info_.points);
}

double CellFile::bytes_per_point() const noexcept {
  if (info_.points == 0) return 0.0;
  return static_cast<double>(file_.size()) / static_cast<double>(info_.points) - halo_bytes_per_point();
}

geometry::Aabb CellFile::box_mm(std::size_t cell) const noexcept {
  return box_of(info_.lattice, entries_[cell]);
}

Status CellFile::read_cell(std::size_t cell, std::vector<std::byte>& scratch, CellPoints& into) const {
  if (cell >= entries_.size())
    return Error{fmt::format("there is no cell {} among {}", cell, entries_.size()), {}, file_.path()};
  const CellEntry& entry = entries_[cell];
  scratch.resize(static_cast<std::size_t>(entry.bytes()));
  PALPATE_TRY(file_.read_at(entry.offset, scratch));
  if (hash_of(scratch) != entry.hash)
    return damaged(fmt::format("cell {} of {} is damaged", cell, entries_.size()));
  into.own = entry.points;
  into.quantum_mm = std::ldexp(info_.lattice.unit_mm(), entry.shift);
  into.points_mm.resize(std::size_t{entry.points} + entry.halo);
  ByteReader reader{std::span<const std::byte>(scratch)};
  constexpr double kMiddle = 0.5;
  const double cubes = std::ldexp(1.0, entry.shift);
  const Vec3 base = real(entry.base) + Vec3::Constant(kMiddle);
  for (Vec3& p : into.points_mm) {
    const double x = reader.u16(), y = reader.u16(), z = reader.u16();
    p = info_.lattice.place_mm(cubes * (base + Vec3(x, y, z)));
  }
  return Done{};
}

Result<CellPoints> CellFile::read_cell(std::size_t cell) const {
  std::vector<std::byte> scratch;
  CellPoints points;
  PALPATE_TRY(read_cell(cell, scratch, points));
  return points;
}

Result<cloud::Cloud> read_cloud(const CellFile& file, const std::optional<geometry::Aabb>& within_mm,
                                std::uint64_t max_bytes, Progress& progress) {
  // A point as three doubles, and as three floats.
  constexpr std::uint64_t kBytesOfReading = 36;
  std::vector<std::size_t> cells;
  std::uint64_t most = 0;
  for (std::size_t cell = 0; cell < file.size(); ++cell) {
    if (within_mm && !within_mm->overlaps(file.box_mm(cell))) continue;
    cells.push_back(cell);
    most += file.entry(cell).points;
  }
  const Error too_large{
      fmt::format("{} points do not fit in the {} bytes of memory allowed, or in what is free", most,
                  max_bytes),
      "take a part of them: --within X,Y,Z,X,Y,Z, or within_mm in a scene; else give more --memory-limit-gb",
      file.path()};
  if (most > max_bytes / kBytesOfReading) return too_large;
  try {
    std::vector<Vec3> points;
    points.reserve(static_cast<std::size_t>(most));
    std::vector<std::byte> bytes;
    CellPoints got;
    for (std::size_t i = 0; i < cells.size(); ++i) {
      progress.report("loading " + file.path(), static_cast<double>(i) / static_cast<double>(cells.size()));
      if (progress.cancelled()) return Error{"stopped while loading the cells"};
      PALPATE_TRY(file.read_cell(cells[i], bytes, got));
      for (const Vec3& p : got.own_mm())
        if (!within_mm || within_mm->contains(p)) points.push_back(p);
    }
    if (within_mm && points.empty())
      return io::nothing_within(*within_mm, file.info().bounds_mm).in_file(file.path());
    return cloud::build_cloud(points, cloud::NonFinite::kRefuse);
  } catch (const std::bad_alloc&) {
    return too_large;
  }
}

}  // namespace palpate::prepared
