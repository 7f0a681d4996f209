#include "toolkit/laz/chunk_decoder.h"

#include <fmt/format.h>

#include <algorithm>
#include <cassert>
#include <cstring>

#include "toolkit/core/bytes.h"

namespace palpate::laz {
namespace {

// Points between two looks at the streams: a chunk that ended early is not decoded to its promise.
constexpr std::uint64_t kPointsPerCheck = 4096;

}  // namespace

Error ChunkDecoder::damaged() const {
  return Error{
      fmt::format("the chunk of {} bytes at byte {} is damaged between its points {} and {}", chunk_.bytes,
                  chunk_.at, decoded_ > kPointsPerCheck ? decoded_ - kPointsPerCheck : 1,
                  std::max<std::uint64_t>(decoded_, 1)),
      kFetchAgain};
}

Result<ChunkDecoder> ChunkDecoder::open(const Compression& how, const Chunk& chunk,
                                        std::vector<std::byte> bytes) {
  ChunkDecoder decoder;
  decoder.chunk_ = chunk;
  decoder.bytes_ = std::move(bytes);
  decoder.point_bytes_ = how.point_bytes;
  for (const Item& item : how.items) decoder.item_bytes_.push_back(item.bytes);
  if (decoder.bytes_.size() < how.point_bytes)
    return Error{fmt::format("the chunk at byte {} has {} bytes, less than a point", chunk.at, chunk.bytes),
                 kFetchAgain};
  PALPATE_TRY(how.layered ? decoder.open_layered(how) : decoder.open_pointwise(how));
  return decoder;
}

Status ChunkDecoder::open_pointwise(const Compression& how) {
  ByteReader in(bytes_);
  for (const Item& item : how.items) {
    pointwise_.push_back(make_pointwise(item));
    pointwise_.back()->begin(in.raw(item.bytes));
  }
  if (chunk_.points > 1) stream_ = ArithmeticDecoder(std::span(bytes_).subspan(point_bytes_));
  return Done{};
}

Status ChunkDecoder::open_layered(const Compression& how) {
  ByteReader in(bytes_);
  (void)in.raw(point_bytes_);
  const std::uint32_t points = in.u32();
  if (!in.good() || points != chunk_.points)
    return Error{fmt::format("the chunk at byte {} says that it has {} points, its file {}", chunk_.at,
                             points, chunk_.points),
                 kFetchAgain};
  std::vector<std::uint32_t> sizes;
  for (const Item& item : how.items) {
    layered_.push_back(make_layered(item));
    for (std::size_t i = 0; i < layered_.back()->layers(); ++i) sizes.push_back(in.u32());
  }
  ByteReader first(bytes_);
  std::size_t layer = 0;
  for (std::size_t i = 0; i < layered_.size(); ++i) {
    std::vector<std::span<const std::byte>> layers(layered_[i]->layers());
    for (std::span<const std::byte>& stream : layers) stream = in.raw(sizes[layer++]);
    layered_[i]->begin(first.raw(item_bytes_[i]), layers, channel_);
  }
  if (!in.good())
    return Error{fmt::format("the layers of the chunk at byte {} do not fit into its {} bytes", chunk_.at,
                             chunk_.bytes),
                 kFetchAgain};
  return Done{};
}

Status ChunkDecoder::decode(std::span<std::byte> points) {
  assert(points.size() % point_bytes_ == 0 && points.size() / point_bytes_ <= points_left());
  while (!points.empty()) {
    bool possible = true;
    if (decoded_ == 0) {
      std::memcpy(points.data(), bytes_.data(), point_bytes_);
    } else {
      std::span<std::byte> rest = points;
      for (std::size_t i = 0; i < item_bytes_.size(); ++i) {
        const std::span<std::byte> record = rest.first(item_bytes_[i]);
        possible = (pointwise_.empty() ? layered_[i]->next(record, channel_)
                                       : pointwise_[i]->next(stream_, record)) &&
                   possible;
        rest = rest.subspan(item_bytes_[i]);
      }
    }
    points = points.subspan(point_bytes_);
    ++decoded_;
    if (possible && !points.empty() && decoded_ % kPointsPerCheck != 0) continue;
    const bool sound = decoded_ == 1 ||
                       (!stream_.damaged() && std::none_of(layered_.begin(), layered_.end(),
                                                           [](const auto& item) { return item->damaged(); }));
    if (!possible || !sound) return damaged();
  }
  return Done{};
}

}  // namespace palpate::laz
