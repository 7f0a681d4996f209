#include "toolkit/io/byte_source.h"

#include <fmt/format.h>
#include <lzma.h>
#include <zlib.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <limits>
#include <utility>

#include <palpate/result.h>
#include "toolkit/core/csv_dialect.h"

namespace palpate::io {

// ---- files, memory and lines

namespace {

class FileSource final : public ByteSource {
 public:
  explicit FileSource(InputFile file) : file_(std::move(file)) {}

  Result<std::size_t> read(std::span<std::byte> out) override {
    const Result<std::size_t> got = file_.read(out);
    if (got) at_ += *got;
    return got;
  }
  std::optional<std::uint64_t> remaining() const override {
    return file_.size() > at_ ? file_.size() - at_ : 0;
  }
  double fraction() const override {
    const auto size = static_cast<double>(file_.size());
    return size > 0.0 ? std::min(1.0, static_cast<double>(at_) / size) : 0.0;
  }

 private:
  InputFile file_;
  std::uint64_t at_ = 0;
};

// Gives back bytes that were read to look at, then goes on with the source.
class PrefixedSource final : public ByteSource {
 public:
  PrefixedSource(std::span<const std::byte> prefix, std::unique_ptr<ByteSource> rest)
      : rest_(std::move(rest)) {
    std::copy(prefix.begin(), prefix.end(), prefix_.begin());
    length_ = prefix.size();
  }
  static constexpr std::size_t kMaxPrefix = 8;  // the longest magic number, xz's, has 6 bytes

  Result<std::size_t> read(std::span<std::byte> out) override {
    if (at_ == length_) return rest_->read(out);
    const std::size_t n = std::min(out.size(), length_ - at_);
    std::memcpy(out.data(), prefix_.data() + at_, n);
    at_ += n;
    return n;
  }
  std::optional<std::uint64_t> remaining() const override {
    const std::optional<std::uint64_t> rest = rest_->remaining();
    if (!rest) return std::nullopt;
    return *rest + (length_ - at_);
  }
  double fraction() const override { return rest_->fraction(); }

 private:
  std::array<std::byte, kMaxPrefix> prefix_{};
  std::size_t length_ = 0;
  std::size_t at_ = 0;
  std::unique_ptr<ByteSource> rest_;
};

class FileAccess final : public RandomAccess {
 public:
  explicit FileAccess(InputFile file) : file_(std::move(file)) {}
  std::uint64_t size() const noexcept override { return file_.size(); }
  Status read_at(std::uint64_t offset, std::span<std::byte> out) const override {
    return file_.read_at(offset, out);
  }

 private:
  InputFile file_;
};

constexpr std::size_t kFirstBuffer = std::size_t{1} << 16;
// After moving what is left to the front there is always room for the longest line to be whole.
constexpr std::size_t kMaxBuffer = 2 * kMaxLineBytes;

}  // namespace

Result<std::size_t> MemorySource::read(std::span<std::byte> out) {
  const std::size_t n = std::min(out.size(), data_.size() - at_);
  if (n > 0) std::memcpy(out.data(), data_.data() + at_, n);
  at_ += n;
  return n;
}

double MemorySource::fraction() const {
  return data_.empty() ? 1.0 : static_cast<double>(at_) / static_cast<double>(data_.size());
}

Result<std::unique_ptr<ByteSource>> open_file(const std::string& path) {
  PALPATE_ASSIGN(InputFile file, InputFile::open(path));
  return std::unique_ptr<ByteSource>(std::make_unique<FileSource>(std::move(file)));
}

Status MemoryAccess::read_at(std::uint64_t offset, std::span<std::byte> out) const {
  if (offset > data_.size() || out.size() > data_.size() - offset)
    return Error{fmt::format("the data ends at byte {}, {} bytes from {} are needed", data_.size(),
                             out.size(), offset),
                 "the file is cut short: copy it again"};
  if (!out.empty()) std::memcpy(out.data(), data_.data() + offset, out.size());
  return Done{};
}

Result<std::size_t> AccessSource::read(std::span<std::byte> out) {
  const auto n = static_cast<std::size_t>(std::min<std::uint64_t>(out.size(), file_.size() - at_));
  PALPATE_TRY(file_.read_at(at_, out.first(n)));
  at_ += n;
  return n;
}

double AccessSource::fraction() const {
  return file_.size() > 0 ? static_cast<double>(at_) / static_cast<double>(file_.size()) : 1.0;
}

Result<std::unique_ptr<RandomAccess>> open_random_access(const std::string& path) {
  PALPATE_ASSIGN(InputFile file, InputFile::open(path));
  return std::unique_ptr<RandomAccess>(std::make_unique<FileAccess>(std::move(file)));
}

Compression detect_compression(std::span<const std::byte> first) noexcept {
  constexpr unsigned char kGzip[] = {0x1F, 0x8B, 0x08};
  constexpr unsigned char kXz[] = {0xFD, '7', 'z', 'X', 'Z', 0x00};
  if (first.size() >= sizeof kGzip && std::memcmp(first.data(), kGzip, sizeof kGzip) == 0)
    return Compression::kGzip;
  if (first.size() >= sizeof kXz && std::memcmp(first.data(), kXz, sizeof kXz) == 0) return Compression::kXz;
  return Compression::kNone;
}

Result<std::unique_ptr<ByteSource>> open_maybe_compressed(std::unique_ptr<ByteSource> inner,
                                                          DecompressionLimits limits, Compression* kind) {
  std::array<std::byte, PrefixedSource::kMaxPrefix> first{};
  std::size_t have = 0;
  while (have < first.size()) {
    PALPATE_ASSIGN(const std::size_t got, inner->read(std::span(first).subspan(have)));
    if (got == 0) break;
    have += got;
  }
  const std::span<const std::byte> seen(first.data(), have);
  const Compression found = detect_compression(seen);
  if (kind != nullptr) *kind = found;
  std::unique_ptr<ByteSource> whole = std::make_unique<PrefixedSource>(seen, std::move(inner));
  if (found == Compression::kNone) return whole;
  return decompress(std::move(whole), found, limits);
}

Result<std::vector<std::byte>> read_all(ByteSource& source, std::uint64_t max_bytes) {
  // Pieces, so that nothing that has arrived is ever copied beside itself but for one of them.
  constexpr std::size_t kFirstPiece = std::size_t{1} << 16, kLargestPiece = std::size_t{1} << 26;
  const Error too_large = over_memory_limit("the file", max_bytes);
  const std::optional<std::uint64_t> left = source.remaining();
  if (left && *left > max_bytes) return too_large;
  std::vector<std::vector<std::byte>> pieces;
  std::uint64_t have = 0;
  // The whole in one piece where its size is known, and one byte to see that it ends there.
  for (std::size_t size = left ? static_cast<std::size_t>(*left) + 1 : kFirstPiece;;
       size = std::min(2 * size, kLargestPiece)) {
    std::vector<std::byte>& piece = pieces.emplace_back(size);
    std::size_t filled = 0;
    while (filled < size) {
      PALPATE_ASSIGN(const std::size_t got, source.read(std::span(piece).subspan(filled)));
      if (got == 0) break;
      filled += got;
    }
    have += filled;
    if (have > max_bytes) return too_large;
    piece.resize(filled);
    if (filled < size) break;
  }
  if (pieces.size() == 1) return std::move(pieces.front());
  std::vector<std::byte> data;
  data.reserve(static_cast<std::size_t>(have));
  for (std::vector<std::byte>& piece : pieces) {
    data.insert(data.end(), piece.begin(), piece.end());
    piece = {};
  }
  return data;
}

BufferedInput::BufferedInput(ByteSource& source) : source_(source), buffer_(kFirstBuffer) {}

bool BufferedInput::refill() {
  if (ended_ || error_) return false;
  if (begin_ > 0) {
    std::memmove(buffer_.data(), buffer_.data() + begin_, end_ - begin_);
    end_ -= begin_;
    begin_ = 0;
  }
  if (end_ == buffer_.size()) {
    if (buffer_.size() >= kMaxBuffer) return false;
    buffer_.resize(2 * buffer_.size());
  }
  const Result<std::size_t> got =
      source_.read(std::as_writable_bytes(std::span(buffer_.data() + end_, buffer_.size() - end_)));
  if (!got) {
    error_ = got.error();
    return false;
  }
  ended_ = *got == 0;
  end_ += *got;
  return !ended_;
}

bool BufferedInput::next_line(std::string_view& line) {
  if (line_ == 0) {
    while (end_ < buffer_.size() && refill()) continue;
    if (ends_lines_with_cr({buffer_.data(), end_})) line_end_ = '\r';
  }
  std::size_t searched = 0;
  while (true) {
    const std::size_t have = end_ - begin_;
    const char* unsearched = buffer_.data() + begin_ + searched;
    const void* found = have > searched ? std::memchr(unsearched, line_end_, have - searched) : nullptr;
    std::size_t length = have;
    if (found != nullptr) {
      length = searched + static_cast<std::size_t>(static_cast<const char*>(found) - unsearched);
    } else {
      searched = have;
      if (have <= kMaxLineBytes && refill()) continue;
      if (error_ || (have == 0 && ended_)) return false;
    }
    ++line_;
    if (length > kMaxLineBytes) {
      error_ = Error{fmt::format("a line is longer than {} bytes", kMaxLineBytes),
                     "check that the file is what its name says",
                     {},
                     line_};
      return false;
    }
    const char* from = buffer_.data() + begin_;  // read now: refill() moves things even when it fails
    begin_ += length + (found != nullptr ? 1 : 0);
    if (length > 0 && from[length - 1] == '\r') --length;
    line = std::string_view(from, length);
    return line_ > 1 || without_mark(line);
  }
}

bool BufferedInput::without_mark(std::string_view& first_line) {
  const Result<std::size_t> mark = byte_order_mark(first_line);
  if (mark)
    first_line.remove_prefix(*mark);
  else
    error_ = mark.error();
  return mark.ok();
}

const std::byte* BufferedInput::take(std::size_t n) {
  while (end_ - begin_ < n) {
    if (!refill()) return nullptr;
  }
  if (error_) return nullptr;
  const char* at = buffer_.data() + begin_;
  begin_ += n;
  return reinterpret_cast<const std::byte*>(at);
}

std::optional<std::uint64_t> BufferedInput::remaining() const {
  const std::optional<std::uint64_t> rest = source_.remaining();
  if (!rest) return std::nullopt;
  return *rest + (end_ - begin_);
}

Error BufferedInput::error_or(Error otherwise) const {
  if (error_) return *error_;
  if (otherwise.line == 0) otherwise.line = line_;
  return otherwise;
}

// ---- gzip through zlib, xz through liblzma, both streaming with a bounded window

namespace {

constexpr std::size_t kInputChunk = std::size_t{1} << 16;
// xz -9 needs 65 MiB to decode; headers can ask for up to 4 GiB.
constexpr std::uint64_t kXzMemory = std::uint64_t{256} << 20;

Error damaged(const char* format, const char* why) {
  return Error{fmt::format("the {} data is {}", format, why),
               fmt::format("fetch or compress the file again ('{} -t' checks it)", format)};
}

// Base of both decompressors: the input chunk, the limits, the counts.
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
