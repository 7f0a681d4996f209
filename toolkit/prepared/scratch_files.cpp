#include "toolkit/prepared/scratch_files.h"

#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <span>
#include <utility>

#include "toolkit/core/bytes.h"
#include "toolkit/core/hardware.h"
#include "toolkit/core/hash.h"

namespace palpate::prepared {

// ---- points

namespace {

/// Writes of this size are fast on every disk; more gains nothing.
constexpr std::size_t kMostBufferedPoints = (std::size_t{1} << 18) / sizeof(PackedPoint);

}  // namespace

Result<PartFile> PartFile::open(std::string path) {
  Result<LockedFile> file = LockedFile::open(path);
  if (!file) return Error{"cannot create the file: " + file.error().what, file.error().remedy, path};
  if (!file->held())
    return Error{"another program is preparing this file", "wait for it to end, or give another name", path};
  return PartFile(std::move(path), *std::move(file));
}

Error PartFile::cannot(const char* doing) const {
  const int why = errno;
  return Error{fmt::format("cannot {} the file: {}", doing, std::strerror(why)),
               why == ENOSPC ? "free some space on the disk, or name another scratch folder"
                             : "check the disk and the path",
               path_};
}

Status PartFile::write_at(std::uint64_t offset, std::span<const std::byte> bytes) const {
  while (!bytes.empty()) {
    const ssize_t wrote = ::pwrite(file_.fd(), bytes.data(), bytes.size(), static_cast<off_t>(offset));
    if (wrote < 0 && errno == EINTR) continue;
    if (wrote <= 0) return cannot("write");
    offset += static_cast<std::uint64_t>(wrote);
    bytes = bytes.subspan(static_cast<std::size_t>(wrote));
  }
  return Done{};
}

Status PartFile::read_at(std::uint64_t offset, std::span<std::byte> bytes) const {
  while (!bytes.empty()) {
    const ssize_t got = ::pread(file_.fd(), bytes.data(), bytes.size(), static_cast<off_t>(offset));
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) return cannot("read");
    if (got == 0) return Error{"the scratch file is cut short", "remove it and prepare again", path_};
    offset += static_cast<std::uint64_t>(got);
    bytes = bytes.subspan(static_cast<std::size_t>(got));
  }
  return Done{};
}

Status PartFile::resize(std::uint64_t bytes) const {
  if (::ftruncate(file_.fd(), static_cast<off_t>(bytes)) != 0) return cannot("resize");
  return Done{};
}

Result<std::uint64_t> PartFile::size() const {
  struct stat status {};
  if (::fstat(file_.fd(), &status) != 0) return cannot("read");
  return static_cast<std::uint64_t>(std::max<off_t>(status.st_size, 0));
}

Status PartFile::rename_to(const std::string& path) {
  // Without it a power cut after the rename could leave an empty file.
  if (::fsync(file_.fd()) != 0 && errno != EINVAL && errno != EROFS) return cannot("write");
  if (std::rename(path_.c_str(), path.c_str()) != 0) return cannot("rename");
  path_ = path;
  return Done{};
}

void PartFile::remove() const noexcept {
  std::remove(path_.c_str());
}

Status PointScratch::begin_scatter(const std::vector<Region>& regions, std::size_t buffer_bytes) {
  const std::uint64_t points = regions.empty() ? 0 : regions.back().first + regions.back().points;
  PALPATE_TRY(file_->resize(bytes(points)));
  const std::size_t each = buffer_bytes / sizeof(PackedPoint) / std::max<std::size_t>(regions.size(), 1);
  buffer_points_ = std::clamp<std::size_t>(each, 1, kMostBufferedPoints);
  buffers_.assign(regions.size(), {});
  for (std::size_t i = 0; i < regions.size(); ++i) {
    buffers_[i].next = regions[i].first;
    buffers_[i].left = regions[i].points;
    buffers_[i].points.reserve(
        static_cast<std::size_t>(std::min<std::uint64_t>(buffer_points_, regions[i].points)));
  }
  return Done{};
}

Status PointScratch::flush(Buffer& buffer) const {
  PALPATE_TRY(file_->write_at((most_chunk_points_ + buffer.next) * sizeof(PackedPoint),
                              std::as_bytes(std::span(buffer.points))));
  buffer.next += buffer.points.size();
  buffer.points.clear();
  return Done{};
}

Result<bool> PointScratch::end_scatter() {
  bool full = true;
  for (Buffer& buffer : buffers_) {
    PALPATE_TRY(flush(buffer));
    full = full && buffer.left == 0;
  }
  release_memory(buffers_);
  return full;
}

Status PointScratch::read_scattered(std::uint64_t first, std::span<PackedPoint> points) const {
  return file_->read_at((most_chunk_points_ + first) * sizeof(PackedPoint), std::as_writable_bytes(points));
}

Status PointScratch::write_sorted(std::uint64_t first, std::span<const PackedPoint> points) const {
  return file_->write_at(first * sizeof(PackedPoint), std::as_bytes(points));
}

Status PointScratch::read_sorted(std::uint64_t first, std::span<PackedPoint> points) const {
  return file_->read_at(first * sizeof(PackedPoint), std::as_writable_bytes(points));
}

}  // namespace palpate::prepared
