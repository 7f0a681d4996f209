// gzip through zlib, xz through liblzma, both streaming with a bounded window.
#include <fmt/format.h>
#include <lzma.h>
#include <zlib.h>

#include <algorithm>
#include <limits>

#include <palpate/result.h>
#include "toolkit/io/byte_source.h"

namespace palpate::io {
namespace {

constexpr std::size_t kInputChunk = std::size_t{1} << 16;
// xz -9 needs 65 MiB to decode; headers can ask for up to 4 GiB.
constexpr std::uint64_t kXzMemory = std::uint64_t{256} << 20;

Error damaged(const char* format, const char* why) {
  return Error{fmt::format("the {} data is {}", format, why),
               fmt::format("fetch or compress the file again ('{} -t' checks it)", format)};
}

// What both decompressors share: the input chunk, the limits, the counts.
class Decompressor : public ByteSource {
 public:
  Decompressor(std::unique_ptr<ByteSource> inner, DecompressionLimits limits)
      : inner_(std::move(inner)), limits_(limits), input_(kInputChunk) {}
  std::optional<std::uint64_t> remaining() const override { return std::nullopt; }
  double fraction() const override { return inner_->fraction(); }

  Result<std::size_t> read(std::span<std::byte> out) final {
    if (out.empty() || ended_) return std::size_t{0};
    Result<std::size_t> got = decode(out);
    if (!got) return got;
    total_out_ += *got;
    if (total_out_ > limits_.max_bytes) return over_memory_limit("the unpacked file", limits_.max_bytes);
    if (total_out_ > limits_.ratio_from_bytes && total_out_ / limits_.max_ratio > total_in_)
      return Error{
          fmt::format("the file unpacks to more than {} times its size, as no scan does", limits_.max_ratio),
          "unpack it by hand if it is genuine"};
    return got;
  }

 protected:
  virtual Result<std::size_t> decode(std::span<std::byte> out) = 0;
  /// The next chunk of compressed bytes; empty at the end.
  Result<std::span<std::byte>> next_input() {
    PALPATE_ASSIGN(const std::size_t got, inner_->read(input_));
    total_in_ += got;
    return std::span(input_).first(got);
  }
  bool ended_ = false;

 private:
  std::unique_ptr<ByteSource> inner_;
  DecompressionLimits limits_;
  std::vector<std::byte> input_;
  std::uint64_t total_in_ = 0;
  std::uint64_t total_out_ = 0;
};

class GzipSource final : public Decompressor {
 public:
  using Decompressor::Decompressor;
  ~GzipSource() override {
    if (open_) inflateEnd(&stream_);
  }
  bool start() {
    constexpr int kGzipFormat = 16;  // added to the window bits: expect a gzip header
    open_ = inflateInit2(&stream_, MAX_WBITS + kGzipFormat) == Z_OK;
    return open_;
  }

 private:
  Result<std::size_t> decode(std::span<std::byte> out) override {
    const std::size_t room = std::min<std::size_t>(out.size(), std::numeric_limits<uInt>::max());
    stream_.next_out = reinterpret_cast<Bytef*>(out.data());
    stream_.avail_out = static_cast<uInt>(room);
    while (stream_.avail_out == room) {
      if (stream_.avail_in == 0) {
        PALPATE_ASSIGN(std::span<std::byte> input, next_input());
        if (input.empty()) {
          if (!between_) return damaged("gzip", "cut off");
          ended_ = true;
          break;
        }
        stream_.next_in = reinterpret_cast<Bytef*>(input.data());
        stream_.avail_in = static_cast<uInt>(input.size());
      }
      if (between_ && !next_member()) continue;
      const int code = inflate(&stream_, Z_NO_FLUSH);
      if (code == Z_STREAM_END) {
        between_ = true;
      } else if (code != Z_OK && !(code == Z_BUF_ERROR && stream_.avail_in == 0)) {
        return damaged("gzip", "damaged");
      }
    }
    return room - stream_.avail_out;
  }

  // After one member: zeros are padding, anything else starts another member.
  bool next_member() {
    while (stream_.avail_in > 0 && *stream_.next_in == 0) {
      ++stream_.next_in;
      --stream_.avail_in;
    }
    if (stream_.avail_in == 0) return false;
    inflateReset(&stream_);
    between_ = false;
    return true;
  }

  z_stream stream_{};
  bool open_ = false;
  bool between_ = false;
};

class XzSource final : public Decompressor {
 public:
  using Decompressor::Decompressor;
  ~XzSource() override { lzma_end(&stream_); }
  bool start() { return lzma_stream_decoder(&stream_, kXzMemory, LZMA_CONCATENATED) == LZMA_OK; }

 private:
  Result<std::size_t> decode(std::span<std::byte> out) override {
    stream_.next_out = reinterpret_cast<std::uint8_t*>(out.data());
    stream_.avail_out = out.size();
    while (stream_.avail_out == out.size()) {
      if (stream_.avail_in == 0 && !finished_) {
        PALPATE_ASSIGN(std::span<std::byte> input, next_input());
        finished_ = input.empty();
        stream_.next_in = reinterpret_cast<const std::uint8_t*>(input.data());
        stream_.avail_in = input.size();
      }
      const lzma_ret code = lzma_code(&stream_, finished_ ? LZMA_FINISH : LZMA_RUN);
      if (code == LZMA_STREAM_END) {
        ended_ = true;
        break;
      }
      if (code == LZMA_MEMLIMIT_ERROR)
        return Error{fmt::format("the xz data needs more than {} MiB to unpack", kXzMemory >> 20),
                     "compress it with a smaller dictionary, such as xz -9"};
      if (code == LZMA_BUF_ERROR) return damaged("xz", "cut off");
      if (code != LZMA_OK) return damaged("xz", "damaged");
    }
    return out.size() - stream_.avail_out;
  }

  lzma_stream stream_ = LZMA_STREAM_INIT;
  bool finished_ = false;
};

template <class T>
Result<std::unique_ptr<ByteSource>> started(std::unique_ptr<T> source) {
  if (!source->start()) return Error{"not enough memory to unpack the file", "close other programs"};
  return std::unique_ptr<ByteSource>(std::move(source));
}

}  // namespace

Result<std::unique_ptr<ByteSource>> decompress(std::unique_ptr<ByteSource> inner, Compression kind,
                                               DecompressionLimits limits) {
  switch (kind) {
    case Compression::kGzip:
      return started(std::make_unique<GzipSource>(std::move(inner), limits));
    case Compression::kXz:
      return started(std::make_unique<XzSource>(std::move(inner), limits));
    case Compression::kNone:
      break;
  }
  return inner;
}

}  // namespace palpate::io
