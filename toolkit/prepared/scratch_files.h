// Files that a preparation goes on with, and the one of packed points: all points, sixteen bytes each, first
// scattered to their regions, then sorted chunk after chunk.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <palpate/result.h>
#include "toolkit/core/files.h"
#include "toolkit/prepared/cell_lattice.h"
#include "toolkit/prepared/cell_partition.h"

namespace palpate::prepared {

/// Reads and writes parts of a file that is being made and may be gone on with; keeps what is there. Movable.
class PartFile {
 public:
  /// Opens or creates, and locks: a second user is an Error.
  [[nodiscard]] static Result<PartFile> open(std::string path);
  [[nodiscard]] Status write_at(std::uint64_t offset, std::span<const std::byte> bytes) const;
  /// Thread-safe, as write_at().
  [[nodiscard]] Status read_at(std::uint64_t offset, std::span<std::byte> bytes) const;
  [[nodiscard]] Status resize(std::uint64_t bytes) const;
  [[nodiscard]] Result<std::uint64_t> size() const;
  /// Flushes to the disk and renames; the lock stays.
  [[nodiscard]] Status rename_to(const std::string& path);
  /// Removes the name; the file lives until it is closed.
  void remove() const noexcept;
  [[nodiscard]] const std::string& path() const noexcept { return path_; }

 private:
  PartFile(std::string path, LockedFile file) : path_(std::move(path)), file_(std::move(file)) {}
  [[nodiscard]] Error cannot(const char* doing) const;
  std::string path_;
  LockedFile file_;
};

/// Sorted points stand one chunk before the scattered ones, so that a chunk is written without touching what
/// is still to be sorted, and a stop at any moment loses nothing: the file is one chunk larger than the
/// points. Not thread-safe but for read_sorted().
class PointScratch {
 public:
  PointScratch(const PartFile& file, std::uint64_t most_chunk_points)
      : file_(&file), most_chunk_points_(most_chunk_points) {}

  /// Sets the file's size and buffers for the regions, in at most `buffer_bytes`.
  [[nodiscard]] Status begin_scatter(const std::vector<Region>& regions, std::size_t buffer_bytes);
  /// Adds a point to a region. False: the region is full, so that the points are not those that were counted.
  [[nodiscard]] Result<bool> add(std::uint32_t region, const PackedPoint& point) {
    Buffer& buffer = buffers_[region];
    if (buffer.left == 0) return false;
    --buffer.left;
    buffer.points.push_back(point);
    if (buffer.points.size() < buffer_points_) return true;
    PALPATE_TRY(flush(buffer));
    return true;
  }
  /// Writes what is buffered. False: some region is not full.
  [[nodiscard]] Result<bool> end_scatter();

  [[nodiscard]] Status read_scattered(std::uint64_t first, std::span<PackedPoint> points) const;
  [[nodiscard]] Status write_sorted(std::uint64_t first, std::span<const PackedPoint> points) const;
  [[nodiscard]] Status read_sorted(std::uint64_t first, std::span<PackedPoint> points) const;
  /// Size of the file for so many points.
  [[nodiscard]] std::uint64_t bytes(std::uint64_t points) const noexcept {
    return (points + most_chunk_points_) * sizeof(PackedPoint);
  }

 private:
  struct Buffer {
    std::uint64_t next = 0;  ///< number of the first buffered point
    std::uint64_t left = 0;  ///< points that the region still takes
    std::vector<PackedPoint> points;
  };
  [[nodiscard]] Status flush(Buffer& buffer) const;

  const PartFile* file_;
  std::uint64_t most_chunk_points_;
  std::size_t buffer_points_ = 0;
  std::vector<Buffer> buffers_;
};

}  // namespace palpate::prepared
