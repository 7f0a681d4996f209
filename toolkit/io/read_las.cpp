#include "toolkit/io/read_las.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <new>
#include <utility>
#include <vector>

#include "toolkit/core/bytes.h"
#include "toolkit/core/parallel.h"
#include "toolkit/io/las_header.h"

namespace palpate::io {

// ---- points as they stand in the file

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

// ---- models and streams

namespace {

constexpr std::array<const char*, 4> kPropertyNames{"intensity", "red", "green", "blue"};

Vec3 position_of(std::span<const std::byte> point, const LasHeader& header) noexcept {
  ByteReader in(point);
  const double x = in.i32(), y = in.i32(), z = in.i32();
  return header.offset + Vec3(x, y, z).cwiseProduct(header.scale);
}

// Takes points of a piece into a DecodedFile.
void take_points(std::span<const std::byte> piece, const LasHeader& header, DecodedFile& decoded) {
  for (; !piece.empty(); piece = piece.subspan(header.point_bytes)) {
    const std::span<const std::byte> point = piece.first(header.point_bytes);
    decoded.points.push_back(position_of(point, header));
    decoded.properties[0].values.push_back(ByteReader(point.subspan(kLasIntensityAt)).u16());
    ByteReader colours(point.subspan(header.colour_at));
    for (std::size_t i = 1; i < decoded.properties.size(); ++i)
      decoded.properties[i].values.push_back(colours.u16());
  }
}

Result<DecodedFile> decode_las(const RandomAccess& file, const ReadOptions& options, Progress& progress) {
  PALPATE_ASSIGN(const LasHeader header, read_las_header(file));
  DecodedFile decoded;
  decoded.format = header.format;
  decoded.unit = header.unit.unit;
  decoded.conventional_unit = header.unit.conventional_unit;
  decoded.warnings = header.warnings;
  const std::size_t properties = header.colour_at > 0 ? kPropertyNames.size() : 1;
  for (std::size_t i = 0; i < properties; ++i) decoded.properties.push_back({kPropertyNames[i], {}});

  PALPATE_ASSIGN(LasPoints points, LasPoints::open(file, header, 0));
  PALPATE_TRY(check_memory(points.points(), sizeof(Vec3) + properties * sizeof(float), "points", options));
  // LAZ promises points that may not be there.
  constexpr std::uint64_t kReservedUnseen = std::uint64_t{1} << 20;
  const auto reserved = static_cast<std::size_t>(
      header.compression ? std::min(points.points(), kReservedUnseen) : points.points());
  decoded.points.reserve(reserved);
  for (cloud::Property& property : decoded.properties) property.values.reserve(reserved);
  while (true) {
    PALPATE_ASSIGN(const std::span<const std::byte> piece, points.next());
    if (piece.empty()) break;
    take_points(piece, header, decoded);
    progress.report("reading",
                    static_cast<double>(points.points_given()) / static_cast<double>(points.points()));
    if (progress.cancelled()) return Error{"reading was stopped"};
  }
  return decoded;
}

class LasStream final : public PointStream {
 public:
  LasStream(std::unique_ptr<RandomAccess> file, LasHeader las, std::string name)
      : file_(std::move(file)), las_(std::move(las)), name_(std::move(name)) {
    header_.format = las_.format;
    header_.unit = las_.unit.unit;
    header_.conventional_unit = las_.unit.conventional_unit;
    header_.bounds = las_.bounds;
    header_.warnings = las_.warnings;
  }

  // Apart from the constructor: it may fail, and keeps addresses of this object's parts.
  Status open_points(int threads) {
    Result<LasPoints> points = LasPoints::open(*file_, las_, threads);
    if (!points) return std::move(points).error().in_file(name_);
    points_ = std::move(*points);
    header_.points = points_->points();
    return Done{};
  }

  [[nodiscard]] const StreamHeader& header() const noexcept override { return header_; }

  Result<std::size_t> read(std::span<Vec3> out) override {
    std::size_t written = 0;
    while (written < out.size()) {
      if (piece_.empty()) {
        if (error_) break;
        Result<std::span<const std::byte>> next = points_->next();
        if (!next) {
          error_ = std::move(next).error().in_file(name_);
          break;
        }
        piece_ = *next;
        if (piece_.empty()) break;
      }
      const std::size_t points = std::min(out.size() - written, piece_.size() / las_.point_bytes);
      for (std::size_t i = 0; i < points; ++i)
        out[written + i] = position_of(piece_.subspan(i * las_.point_bytes), las_);
      written += points;
      piece_ = piece_.subspan(points * las_.point_bytes);
    }
    if (written == 0 && error_ && !out.empty()) return *error_;
    return written;
  }

  Status rewind() override {
    points_->rewind();
    piece_ = {};
    error_.reset();
    return Done{};
  }

 private:
  std::unique_ptr<RandomAccess> file_;
  LasHeader las_;
  std::string name_;
  StreamHeader header_;
  std::optional<LasPoints> points_;
  std::span<const std::byte> piece_;
  std::optional<Error> error_;  ///< behind the points that were given
};

}  // namespace

Result<DecodedFile> read_las(const RandomAccess& file, const std::string& name, const ReadOptions& options,
                             Progress& progress) {
  Result<DecodedFile> decoded = decode_las(file, options, progress);
  if (!decoded) return std::move(decoded).error().in_file(name);
  return decoded;
}

Result<DecodedFile> read_las_bytes(const ReaderInput& input) {
  PALPATE_ASSIGN(const std::vector<std::byte> bytes, read_all(input.bytes, input.options.max_bytes));
  return read_las(MemoryAccess(bytes), input.name, input.options, input.progress);
}

Result<std::unique_ptr<PointStream>> las_stream(std::unique_ptr<RandomAccess> file, const std::string& name,
                                                int threads) {
  Result<LasHeader> header = read_las_header(*file);
  if (!header) return std::move(header).error().in_file(name);
  auto stream = std::make_unique<LasStream>(std::move(file), std::move(*header), name);
  PALPATE_TRY(stream->open_points(threads));
  return std::unique_ptr<PointStream>(std::move(stream));
}

}  // namespace palpate::io
