#include "toolkit/io/las_points.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <new>

#include "toolkit/core/bytes.h"
#include "toolkit/core/parallel.h"

namespace palpate::io {
namespace {

// Bytes of points that are held at once, per thread: a chunk of 50,000 points, which is usual, has 1 to 4 MB.
constexpr std::uint64_t kPieceBytes = std::uint64_t{16} << 20;
// Compressed bytes of a chunk: far more than a piece compresses to, and still to be held by every thread.
constexpr std::uint64_t kMostChunkBytes = std::uint64_t{1} << 28;
// Bytes before the first chunk that say where the table of chunks stands, and the mark of a writer that could
// not go back to fill them in: they stand at the file's end then.
constexpr std::size_t kTablePlaceBytes = 8;
constexpr std::uint64_t kTablePlaceAtEnd = ~std::uint64_t{0};

Result<std::uint64_t> read_place(const RandomAccess& file, std::uint64_t at) {
  std::array<std::byte, kTablePlaceBytes> bytes{};
  PALPATE_TRY(file.read_at(at, bytes));
  return ByteReader(bytes).u64();
}

}  // namespace

LasPoints::LasPoints(const RandomAccess& file, const LasHeader& header, int threads)
    : file_(&file),
      header_(&header),
      threads_(threads > 0 ? std::min(threads, available_threads()) : available_threads()),
      points_(header.points),
      piece_points_(std::max<std::uint64_t>(1, kPieceBytes / header.point_bytes)) {}

Result<LasPoints> LasPoints::open(const RandomAccess& file, const LasHeader& header, int threads) {
  LasPoints points(file, header, threads);
  if (header.compression)
    PALPATE_TRY(points.find_chunks());
  else
    points.points_ = std::min(header.points, (file.size() - header.points_at) / header.point_bytes);
  return points;
}

void LasPoints::rewind() noexcept {
  given_ = 0;
  next_chunk_ = next_in_batch_ = 0;
  long_chunk_.reset();
  batch_.clear();
  error_.reset();
}

Status LasPoints::find_chunks() {
  if (points_ == 0) return Done{};
  const std::uint64_t first = header_->points_at + kTablePlaceBytes;
  const Error no_table{fmt::format("the file has no table of its chunks: it ends at byte {}", file_->size()),
                       kLasIsCut};
  if (file_->size() < first + kTablePlaceBytes) return no_table;
  PALPATE_ASSIGN(std::uint64_t table_at, read_place(*file_, header_->points_at));
  if (table_at == kTablePlaceAtEnd) {
    PALPATE_ASSIGN(table_at, read_place(*file_, file_->size() - kTablePlaceBytes));
  }
  if (table_at < first || table_at > file_->size() - laz::kChunkTableStart) {
    Error error = no_table;
    error.what =
        fmt::format("the table of chunks should stand at byte {} (says byte {}), the file ends at {}",
                    table_at, header_->points_at, file_->size());
    return error;
  }
  std::array<std::byte, laz::kChunkTableStart> start{};
  PALPATE_TRY(file_->read_at(table_at, start));
  PALPATE_ASSIGN(const std::uint32_t chunks,
                 laz::read_chunk_count(start, *header_->compression, first, table_at));
  const std::uint64_t table_begin = table_at + laz::kChunkTableStart;
  const std::uint64_t most = std::uint64_t{chunks} * laz::kMostTableBytesPerChunk + laz::kChunkTableEnd;
  std::vector<std::byte> table(static_cast<std::size_t>(std::min(most, file_->size() - table_begin)));
  PALPATE_TRY(file_->read_at(table_begin, table));
  PALPATE_ASSIGN(chunks_,
                 laz::read_chunk_table(table, chunks, *header_->compression, first, table_at, points_));
  return Done{};
}

Result<std::span<const std::byte>> LasPoints::next() {
  PALPATE_ASSIGN(std::span<const std::byte> piece, header_->compression ? next_decoded() : next_plain());
  // The last chunk may hold more than the header promises.
  const std::uint64_t left = points_ - given_;
  const std::uint64_t points = std::min<std::uint64_t>(piece.size() / header_->point_bytes, left);
  given_ += points;
  return piece.first(static_cast<std::size_t>(points * header_->point_bytes));
}

Result<std::span<const std::byte>> LasPoints::next_plain() {
  const std::uint64_t points = std::min(piece_points_, points_ - given_);
  if (points == 0 && points_ < header_->points)
    return Error{fmt::format("the file ends at byte {} after {} of the {} points that its header promises",
                             file_->size(), points_, header_->points),
                 kLasIsCut};
  batch_.resize(1);
  batch_[0].resize(static_cast<std::size_t>(points * header_->point_bytes));
  PALPATE_TRY(file_->read_at(header_->points_at + given_ * header_->point_bytes, batch_[0]));
  return std::span<const std::byte>(batch_[0]);
}

Result<laz::ChunkDecoder> LasPoints::open_chunk(const laz::Chunk& chunk) const {
  if (chunk.bytes > kMostChunkBytes)
    return Error{fmt::format("the chunk at byte {} has {} bytes, at most {} are read", chunk.at, chunk.bytes,
                             kMostChunkBytes),
                 "compress the file in the usual chunks: laszip -i in.laz -o out.laz -chunk_size 50000"};
  std::vector<std::byte> bytes(static_cast<std::size_t>(chunk.bytes));
  PALPATE_TRY(file_->read_at(chunk.at, bytes));
  return laz::ChunkDecoder::open(*header_->compression, chunk, std::move(bytes));
}

Result<std::span<const std::byte>> LasPoints::next_of_long_chunk() {
  const std::uint64_t points = std::min(piece_points_, long_chunk_->points_left());
  batch_.resize(1);
  batch_[0].resize(static_cast<std::size_t>(points * header_->point_bytes));
  PALPATE_TRY(long_chunk_->decode(batch_[0]));
  if (long_chunk_->points_left() == 0) long_chunk_.reset();
  next_in_batch_ = batch_.size();
  return std::span<const std::byte>(batch_[0]);
}

void LasPoints::decode_batch() {
  std::size_t count = 0;
  while (count < static_cast<std::size_t>(threads_) && next_chunk_ + count < chunks_.size() &&
         chunks_[next_chunk_ + count].points <= piece_points_)
    ++count;
  batch_.resize(count);
  next_in_batch_ = 0;
  std::vector<std::optional<Error>> errors(count);
  const auto decode = [&](std::size_t i) -> Status {
    const laz::Chunk& chunk = chunks_[next_chunk_ + i];
    PALPATE_ASSIGN(laz::ChunkDecoder decoder, open_chunk(chunk));
    batch_[i].resize(static_cast<std::size_t>(chunk.points * header_->point_bytes));
    return decoder.decode(batch_[i]);
  };
  parallel_chunks(count, 1, threads_, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      try {
        if (Status decoded = decode(i); !decoded) errors[i] = decoded.error();
      } catch (const std::bad_alloc&) {
        errors[i] = Error{"there is not enough memory to decode the points", "close other programs"};
      }
    }
  });
  next_chunk_ += count;
  const auto bad =
      std::find_if(errors.begin(), errors.end(), [](const auto& error) { return error.has_value(); });
  if (bad == errors.end()) return;
  error_ = std::move(*bad);
  batch_.resize(static_cast<std::size_t>(bad - errors.begin()));
}

Result<std::span<const std::byte>> LasPoints::next_decoded() {
  if (long_chunk_) return next_of_long_chunk();
  if (next_in_batch_ == batch_.size() && !error_) {
    if (next_chunk_ == chunks_.size()) return std::span<const std::byte>();
    if (chunks_[next_chunk_].points > piece_points_) {
      PALPATE_ASSIGN(long_chunk_, open_chunk(chunks_[next_chunk_]));
      ++next_chunk_;
      return next_of_long_chunk();
    }
    decode_batch();
  }
  if (next_in_batch_ < batch_.size()) return std::span<const std::byte>(batch_[next_in_batch_++]);
  return *error_;
}

}  // namespace palpate::io
