// Prepared points: a file of cells in Morton order, each with copies of the points around it (its halo), so
// that a cell is worked on alone. Any cell is one read; the table of all cells stays in memory.
//
// Layout, little-endian: a header of 256 bytes; the cells' points, own before halo, three 16-bit numbers each
// in steps of the cell's quantum; the table, 128 bytes a cell. Each cell, the table and the header have an
// FNV-1a hash of 64 bits.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <palpate/cloud.h>
#include <palpate/geometry.h>
#include <palpate/progress.h>
#include <palpate/result.h>
#include "toolkit/core/bytes.h"
#include "toolkit/core/files.h"
#include "toolkit/prepared/cell_lattice.h"

namespace palpate::prepared {

/// A cell's own points at most: 24 KB in the file and 96 KB as doubles, within a core's cache.
inline constexpr std::uint32_t kMostCellPoints = 4096;
/// A halo's points at most, for the same reason; a denser surrounding gets a thinner halo.
inline constexpr std::uint32_t kMostHaloPoints = 4096;
inline constexpr std::size_t kBytesPerPoint = 3 * sizeof(std::uint16_t);
/// Steps that a coordinate of a cell can count.
inline constexpr std::uint64_t kMostSteps = 0xFFFFu;
inline constexpr std::uint32_t kCellFileVersion = 1;
inline constexpr std::size_t kCellHeaderBytes = 256;
inline constexpr std::size_t kCellEntryBytes = 128;

/// One line of the table.
struct CellEntry {
  CellKey key;               ///< of the tree's node, the bits below `depth` 0
  std::uint8_t depth = 0;    ///< bits of the key that count
  std::uint8_t shift = 0;    ///< the quantum is 2^shift cubes
  std::uint32_t points = 0;  ///< own
  std::uint32_t halo = 0;
  std::uint64_t offset = 0;    ///< of its points in the file
  LatticePoint low{}, high{};  ///< box of its own points, both inclusive
  LatticePoint base{};         ///< of the numbers, in quanta
  double halo_mm = 0.0;        ///< halo: the other cells' points nearer to the box than this
  std::uint64_t hash = 0;      ///< of its bytes

  [[nodiscard]] std::uint64_t bytes() const noexcept {
    return (std::uint64_t{points} + halo) * kBytesPerPoint;
  }
};
void write_cell_entry(ByteWriter& writer, const CellEntry& entry) noexcept;
[[nodiscard]] CellEntry read_cell_entry(ByteReader& reader) noexcept;

/// Statements of the file's head.
struct CellFileInfo {
  std::uint64_t points = 0;
  std::uint64_t dropped = 0;  ///< points of the input that were not finite or too far away
  std::uint64_t halo_points = 0;
  std::uint64_t cells = 0;
  geometry::Aabb bounds_mm;       ///< of the input's points, exactly
  double asked_quantum_mm = 0.0;  ///< the requested limit
  double quantum_mm = 0.0;        ///< the largest of a cell; a coordinate is off by at most half of it
  double halo_spacings = 0.0;     ///< width of the halo in the cell's spacings
  double mm_per_unit = 1.0;       ///< of the input, already applied
  CellLattice lattice;
};
/// The header's bytes, for a table that begins at `table_offset`.
[[nodiscard]] std::vector<std::byte> encode_cell_header(const CellFileInfo& info, std::uint64_t table_offset,
                                                        std::uint64_t table_hash);

/// A cell's points in mm.
struct CellPoints {
  std::vector<Vec3> points_mm;  ///< own before halo
  std::size_t own = 0;
  double quantum_mm = 0.0;

  [[nodiscard]] std::span<const Vec3> own_mm() const noexcept { return std::span(points_mm).first(own); }
};

/// An open file of cells. Immutable; thread-safe. Movable.
class CellFile {
 public:
  /// Reads and checks the table; the points are checked cell by cell when read.
  [[nodiscard]] static Result<CellFile> open(const std::string& path);
  /// Whether a file's first bytes are those of one.
  [[nodiscard]] static bool begins_as_one(std::span<const std::byte> first_bytes) noexcept;

  [[nodiscard]] const CellFileInfo& info() const noexcept { return info_; }
  [[nodiscard]] std::size_t size() const noexcept { return entries_.size(); }
  [[nodiscard]] const CellEntry& entry(std::size_t cell) const noexcept { return entries_[cell]; }
  /// Holds every own point of the cell as it is read.
  [[nodiscard]] geometry::Aabb box_mm(std::size_t cell) const noexcept;
  /// Bytes of the file per point: of its own points and the table, and of the halo.
  [[nodiscard]] double bytes_per_point() const noexcept;
  [[nodiscard]] double halo_bytes_per_point() const noexcept;
  [[nodiscard]] const std::string& path() const noexcept { return file_.path(); }

  /// Reads one cell into `into`, whose memory is used again; `scratch` holds the bytes. A damaged cell is an
  /// Error that names it.
  [[nodiscard]] Status read_cell(std::size_t cell, std::vector<std::byte>& scratch, CellPoints& into) const;
  [[nodiscard]] Result<CellPoints> read_cell(std::size_t cell) const;

 private:
  explicit CellFile(InputFile file) : file_(std::move(file)) {}
  [[nodiscard]] Error damaged(const std::string& what) const;
  [[nodiscard]] Status read_header(std::uint64_t& table_offset, std::uint64_t& table_hash);
  [[nodiscard]] Status read_table(std::uint64_t table_offset, std::uint64_t table_hash);
  [[nodiscard]] Status check_entry(std::size_t cell, std::uint64_t offset) const;

  InputFile file_;
  CellFileInfo info_;
  std::vector<CellEntry> entries_;
};

/// The own points of all cells, in Morton order, or those in a closed box: of the cells that it overlaps, and
/// no other is read. Errors: a damaged cell, a box without points, cells to read that take more than
/// `max_bytes` or than there is.
[[nodiscard]] Result<cloud::Cloud> read_cloud(const CellFile& file,
                                              const std::optional<geometry::Aabb>& within_mm,
                                              std::uint64_t max_bytes, Progress& progress);

}  // namespace palpate::prepared
