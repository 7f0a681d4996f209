#include "toolkit/io/byte_source.h"

#include <fmt/format.h>
#include <sys/stat.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdio>
#include <cstring>

namespace palpate::io {
namespace {

struct Close {
  void operator()(std::FILE* file) const noexcept { std::fclose(file); }
};

class FileSource final : public ByteSource {
 public:
  FileSource(std::string path, std::FILE* file, std::optional<std::uint64_t> size)
      : path_(std::move(path)), file_(file), size_(size) {}

  Result<std::size_t> read(std::span<std::byte> out) override {
    const std::size_t got = std::fread(out.data(), 1, out.size(), file_.get());
    if (got < out.size() && std::ferror(file_.get()) != 0)
      return Error{fmt::format("cannot read the file: {}", std::strerror(errno)),
                   "check the disk and the path", path_, 0};
    at_ += got;
    return got;
  }
  std::optional<std::uint64_t> remaining() const override {
    if (!size_) return std::nullopt;
    return *size_ > at_ ? *size_ - at_ : 0;
  }
  double fraction() const override {
    return size_ && *size_ > 0 ? std::min(1.0, static_cast<double>(at_) / static_cast<double>(*size_)) : 0.0;
  }

 private:
  std::string path_;
  std::unique_ptr<std::FILE, Close> file_;
  std::optional<std::uint64_t> size_;
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
  struct stat status {};
  if (::stat(path.c_str(), &status) != 0) {
    if (errno == ENOENT || errno == ENOTDIR) return Error{"no such file", "check the path", path, 0};
    return Error{fmt::format("cannot open the file: {}", std::strerror(errno)),
                 "check the path and its permissions", path, 0};
  }
  if (S_ISDIR(status.st_mode)) return Error{"this is a folder, not a file", "name a file inside it", path, 0};
  std::FILE* file = std::fopen(path.c_str(), "rb");
  if (file == nullptr)
    return Error{fmt::format("cannot open the file: {}", std::strerror(errno)),
                 "check the path and its permissions", path, 0};
  std::optional<std::uint64_t> size;
  if (S_ISREG(status.st_mode)) size = static_cast<std::uint64_t>(status.st_size);
  return std::unique_ptr<ByteSource>(std::make_unique<FileSource>(path, file, size));
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
    const Result<std::size_t> got = inner->read(std::span(first).subspan(have));
    if (!got) return got.error();
    if (*got == 0) break;
    have += *got;
  }
  const std::span<const std::byte> seen(first.data(), have);
  const Compression found = detect_compression(seen);
  if (kind != nullptr) *kind = found;
  std::unique_ptr<ByteSource> whole = std::make_unique<PrefixedSource>(seen, std::move(inner));
  if (found == Compression::kNone) return whole;
  return decompress(std::move(whole), found, limits);
}

Result<std::vector<std::byte>> read_all(ByteSource& source, std::uint64_t max_bytes) {
  constexpr std::size_t kFirstChunk = std::size_t{1} << 16;
  std::vector<std::byte> data;
  std::size_t have = 0;
  if (const std::optional<std::uint64_t> left = source.remaining(); left && *left <= max_bytes)
    data.resize(static_cast<std::size_t>(*left));
  while (true) {
    if (have == data.size()) {
      // Doubling keeps what is reserved in proportion to what arrived.
      std::byte probe{};
      const Result<std::size_t> more = source.read(std::span(&probe, 1));
      if (!more) return more.error();
      if (*more == 0) break;
      if (have >= max_bytes)
        return Error{fmt::format("the file holds more than the {} bytes allowed", max_bytes),
                     "raise the memory bound if the file is meant to be this large",
                     {},
                     0};
      const std::uint64_t wanted = std::max<std::uint64_t>(kFirstChunk, 2 * static_cast<std::uint64_t>(have));
      data.resize(static_cast<std::size_t>(std::min(wanted, max_bytes)));
      data[have++] = probe;
      continue;
    }
    const Result<std::size_t> got = source.read(std::span(data).subspan(have));
    if (!got) return got.error();
    if (*got == 0) break;
    have += *got;
  }
  data.resize(have);
  return data;
}

}  // namespace palpate::io
