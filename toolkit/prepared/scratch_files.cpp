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

// ---- surface chunks

namespace {

using spline_sdf::ChunkBrick;
using spline_sdf::SurfaceChunk;

/// First code, numbers of own, rim and seam bricks and of pieces, sums of distances, patches.
constexpr std::size_t kChunkHeadBytes = 8 * sizeof(std::uint64_t);
constexpr std::size_t kChunkBrickBytes = 8 + 4 + 4 + 6 * 4;
/// The length before a record and the hash after it.
constexpr std::size_t kRecordEdgeBytes = sizeof(std::uint64_t);

void write_chunk_brick(const ChunkBrick& one, ByteWriter& to) {
  to.u64(one.code);
  to.u8(static_cast<std::uint8_t>(one.level));
  to.u8(one.summary.cells);
  to.u8(one.summary.beyond);
  to.u8(one.summary.smaller ? 1 : 0);
  to.u32(one.summary.piece);
  for (int a = 0; a < 3; ++a) to.single(one.summary.part.middle[a]);
  for (int a = 0; a < 3; ++a) to.single(one.summary.part.area[a]);
}

void read_chunk_brick(ByteReader& from, ChunkBrick& one) {
  one.code = from.u64();
  one.level = from.u8();
  one.summary.cells = from.u8();
  one.summary.beyond = from.u8();
  one.summary.smaller = from.u8() != 0;
  one.summary.piece = from.u32();
  for (int a = 0; a < 3; ++a) one.summary.part.middle[a] = from.single();
  for (int a = 0; a < 3; ++a) one.summary.part.area[a] = from.single();
}

std::uint64_t hash_of_record(std::span<const std::byte> bytes) noexcept {
  Hash64 hash;
  hash.bytes(bytes);
  return hash.value();
}

std::vector<std::byte> encode_chunk(const SurfaceChunk& chunk) {
  std::vector<std::byte> bytes(kChunkHeadBytes + chunk.groups.size() * sizeof(std::uint32_t) +
                               (chunk.rim.size() + chunk.seam.size() + chunk.own.size()) * kChunkBrickBytes +
                               chunk.bricks.size() * spline_sdf::kStoredBrickBytes);
  ByteWriter to{std::span(bytes)};
  to.u64(chunk.first_code);
  to.u64(chunk.own.size());
  to.u64(chunk.rim.size());
  to.u64(chunk.seam.size());
  to.u64(chunk.groups.size());
  to.u64(chunk.distances.squares);
  to.u64(chunk.distances.count);
  to.u64(chunk.patches);
  for (const std::uint32_t group : chunk.groups) to.u32(group);
  for (const auto* bricks : {&chunk.rim, &chunk.seam, &chunk.own})
    for (const ChunkBrick& one : *bricks) write_chunk_brick(one, to);
  for (const spline_sdf::Brick& brick : chunk.bricks) spline_sdf::write_stored_brick(brick, to);
  return bytes;
}

/// All but the bricks, of bytes whose hash was right. False where they are not as many as they say.
bool decode_chunk(std::span<const std::byte> bytes, SurfaceChunk& chunk) {
  ByteReader from(bytes);
  chunk.first_code = from.u64();
  const std::uint64_t own = from.u64(), rim = from.u64(), seam = from.u64(), groups = from.u64();
  const std::uint64_t most = bytes.size();  // each takes more than one, so that the sum below cannot overflow
  if (own > most || rim > most || seam > most || groups > most ||
      kChunkHeadBytes + groups * sizeof(std::uint32_t) + (own + rim + seam) * kChunkBrickBytes +
              own * spline_sdf::kStoredBrickBytes !=
          most)
    return false;
  chunk.own.resize(static_cast<std::size_t>(own));
  chunk.rim.resize(static_cast<std::size_t>(rim));
  chunk.seam.resize(static_cast<std::size_t>(seam));
  chunk.groups.resize(static_cast<std::size_t>(groups));
  chunk.distances.squares = from.u64();
  chunk.distances.count = from.u64();
  chunk.patches = from.u64();
  for (std::uint32_t& group : chunk.groups) group = from.u32();
  for (auto* bricks : {&chunk.rim, &chunk.seam, &chunk.own})
    for (ChunkBrick& one : *bricks) read_chunk_brick(from, one);
  const auto is_numbered = [&](const ChunkBrick& one) {
    return one.summary.piece < groups && one.level < spline_sdf::BrickGrid::kMaxLevels;
  };
  return std::all_of(chunk.own.begin(), chunk.own.end(), is_numbered) &&
         std::all_of(chunk.rim.begin(), chunk.rim.end(), is_numbered) &&
         std::all_of(chunk.seam.begin(), chunk.seam.end(), is_numbered);
}

}  // namespace

Result<ChunkScratch> ChunkScratch::open(const std::string& path, std::uint64_t key) {
  PALPATE_ASSIGN(PartFile file, PartFile::open(path));
  PALPATE_ASSIGN(const std::uint64_t size, file.size());
  ChunkScratch out(std::move(file));
  std::array<std::byte, sizeof(std::uint64_t)> first{};
  if (size >= first.size()) PALPATE_TRY(out.file_.read_at(0, first));
  if (size < first.size() || ByteReader{std::span<const std::byte>(first)}.u64() != key) {
    PALPATE_TRY(out.begin_anew(key));
    return out;
  }
  out.end_ = first.size();
  for (bool more = true; more;) {
    PALPATE_ASSIGN(more, out.read_record(size));
  }
  PALPATE_TRY(out.file_.resize(out.end_));
  return out;
}

Status ChunkScratch::begin_anew(std::uint64_t key) {
  PALPATE_TRY(file_.resize(0));
  std::array<std::byte, sizeof(std::uint64_t)> first{};
  ByteWriter{std::span<std::byte>(first)}.u64(key);
  PALPATE_TRY(file_.write_at(0, first));
  end_ = first.size();
  return Done{};
}

Result<bool> ChunkScratch::read_record(std::uint64_t file_size) {
  if (file_size - end_ < 2 * kRecordEdgeBytes) return false;
  std::array<std::byte, kRecordEdgeBytes> edge{};
  PALPATE_TRY(file_.read_at(end_, edge));
  const std::uint64_t length = ByteReader{std::span<const std::byte>(edge)}.u64();
  if (length > file_size - end_ - 2 * kRecordEdgeBytes) return false;
  std::vector<std::byte> bytes(static_cast<std::size_t>(length));
  PALPATE_TRY(file_.read_at(end_ + kRecordEdgeBytes, bytes));
  PALPATE_TRY(file_.read_at(end_ + kRecordEdgeBytes + length, edge));
  if (ByteReader{std::span<const std::byte>(edge)}.u64() != hash_of_record(bytes)) return false;
  SurfaceChunk chunk;
  if (!decode_chunk(bytes, chunk)) return false;
  keep(std::move(chunk), length);
  return true;
}

Status ChunkScratch::add(SurfaceChunk chunk) {
  const std::vector<std::byte> bytes = encode_chunk(chunk);
  std::array<std::byte, kRecordEdgeBytes> edge{};
  ByteWriter{std::span<std::byte>(edge)}.u64(bytes.size());
  PALPATE_TRY(file_.write_at(end_, edge));
  PALPATE_TRY(file_.write_at(end_ + kRecordEdgeBytes, bytes));
  ByteWriter{std::span<std::byte>(edge)}.u64(hash_of_record(bytes));
  PALPATE_TRY(file_.write_at(end_ + kRecordEdgeBytes + bytes.size(), edge));
  keep(std::move(chunk), bytes.size());
  return Done{};
}

void ChunkScratch::keep(SurfaceChunk chunk, std::uint64_t record_bytes) {
  end_ += 2 * kRecordEdgeBytes + record_bytes;
  Place& place = places_.emplace_back();
  place.counts = spline_sdf::level_counts(chunk);
  place.bricks_at = end_ - kRecordEdgeBytes - chunk.own.size() * spline_sdf::kStoredBrickBytes;
  place.own_at = place.bricks_at - chunk.own.size() * kChunkBrickBytes;
  release_memory(chunk.bricks);
  release_memory(chunk.own);
  chunk.rim.shrink_to_fit();
  chunk.seam.shrink_to_fit();
  chunks_.push_back(std::move(chunk));
}

Status ChunkScratch::read_own(std::size_t chunk, std::size_t first, std::size_t count,
                              std::vector<ChunkBrick>& out) const {
  std::vector<std::byte> bytes(count * kChunkBrickBytes);
  PALPATE_TRY(file_.read_at(places_[chunk].own_at + first * kChunkBrickBytes, bytes));
  out.resize(count);
  ByteReader from(bytes);
  for (ChunkBrick& one : out) read_chunk_brick(from, one);
  return Done{};
}

Status ChunkScratch::read_brick(std::size_t chunk, std::size_t brick, spline_sdf::Brick& out) const {
  std::array<std::byte, spline_sdf::kStoredBrickBytes> bytes;
  PALPATE_TRY(file_.read_at(places_[chunk].bricks_at + brick * bytes.size(), bytes));
  spline_sdf::read_stored_brick(bytes, out);
  return Done{};
}

}  // namespace palpate::prepared
