// Sources of bytes for readers: files, memory, gzip, xz.
//
// Readers see nothing else, so that they work on compressed files and can be fuzzed from memory.
// BufferedInput gives them lines of text and blocks of bytes from one stream.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <palpate/result.h>
#include "toolkit/core/files.h"

namespace palpate::io {

/// A stream of bytes, read once from front to back. Not thread-safe.
class ByteSource {
 public:
  virtual ~ByteSource() = default;
  /// Fills the front of `out` and returns how many bytes it wrote: 0 only at the end (or for an empty `out`).
  [[nodiscard]] virtual Result<std::size_t> read(std::span<std::byte> out) = 0;
  /// Bytes that read() will still give, where that is known (not for compressed data).
  [[nodiscard]] virtual std::optional<std::uint64_t> remaining() const = 0;
  /// Share of the underlying file that is consumed, in [0, 1].
  [[nodiscard]] virtual double fraction() const = 0;
};

/// Bytes that somebody else owns and keeps alive.
class MemorySource final : public ByteSource {
 public:
  explicit MemorySource(std::span<const std::byte> data) : data_(data) {}
  [[nodiscard]] Result<std::size_t> read(std::span<std::byte> out) override;
  [[nodiscard]] std::optional<std::uint64_t> remaining() const override { return data_.size() - at_; }
  [[nodiscard]] double fraction() const override;

 private:
  std::span<const std::byte> data_;
  std::size_t at_ = 0;
};

/// A regular file, as InputFile opens it.
[[nodiscard]] Result<std::unique_ptr<ByteSource>> open_file(const std::string& path);

/// Bytes at any place, for formats with tables at their end. Thread-safe.
class RandomAccess {
 public:
  virtual ~RandomAccess() = default;
  [[nodiscard]] virtual std::uint64_t size() const noexcept = 0;
  /// Fills all of `out` from `offset`, or an Error.
  [[nodiscard]] virtual Status read_at(std::uint64_t offset, std::span<std::byte> out) const = 0;
};

/// Bytes that somebody else owns and keeps alive.
class MemoryAccess final : public RandomAccess {
 public:
  explicit MemoryAccess(std::span<const std::byte> data) : data_(data) {}
  [[nodiscard]] std::uint64_t size() const noexcept override { return data_.size(); }
  [[nodiscard]] Status read_at(std::uint64_t offset, std::span<std::byte> out) const override;

 private:
  std::span<const std::byte> data_;
};

/// Bytes at any place, from front to back. `file` outlives this.
class AccessSource final : public ByteSource {
 public:
  explicit AccessSource(const RandomAccess& file) : file_(file) {}
  [[nodiscard]] Result<std::size_t> read(std::span<std::byte> out) override;
  [[nodiscard]] std::optional<std::uint64_t> remaining() const override { return file_.size() - at_; }
  [[nodiscard]] double fraction() const override;

 private:
  const RandomAccess& file_;
  std::uint64_t at_ = 0;
};

/// A regular file, as InputFile opens it.
[[nodiscard]] Result<std::unique_ptr<RandomAccess>> open_random_access(const std::string& path);

/// Compression of a file, by its first bytes.
enum class Compression { kNone, kGzip, kXz };
[[nodiscard]] Compression detect_compression(std::span<const std::byte> first_bytes) noexcept;

/// Limits beyond which a decompressor refuses its input as hostile.
struct DecompressionLimits {
  std::uint64_t max_bytes = kMemoryLimitBytes;  ///< decoded bytes
  /// Decoded over compressed size, tested once the decoded size is past `ratio_from_bytes`. Scans compress 2
  /// to 30 times, a synthetic regular grid as text some 100 times.
  std::uint64_t max_ratio = 500;
  std::uint64_t ratio_from_bytes = std::uint64_t{64} << 20;
};

/// Decompresses `inner` (owned) on the fly; concatenated streams are read as one. Memory: under 300 MB for
/// any input.
[[nodiscard]] Result<std::unique_ptr<ByteSource>> decompress(std::unique_ptr<ByteSource> inner,
                                                             Compression kind, DecompressionLimits limits);

/// `inner` with decompression put in front where its first bytes ask for it. `kind` (may be null) receives
/// what it was.
[[nodiscard]] Result<std::unique_ptr<ByteSource>> open_maybe_compressed(std::unique_ptr<ByteSource> inner,
                                                                        DecompressionLimits limits,
                                                                        Compression* kind = nullptr);

/// Everything that is left, at most `max_bytes`: more is an Error, before anything is read where the source
/// knows its size. Memory grows with what really arrives, and is at most that and one piece of 64 MiB.
[[nodiscard]] Result<std::vector<std::byte>> read_all(ByteSource& source, std::uint64_t max_bytes);

/// No row of numbers and no header line is longer; an endless line is refused instead of stored.
inline constexpr std::size_t kMaxLineBytes = std::size_t{1} << 20;

class BufferedInput {
 public:
  explicit BufferedInput(ByteSource& source);

  /// The next line without its end (\n, \r\n, or \r in a file that begins so; the last may lack it), the
  /// first without a byte order mark. False at the end of the data, and after an error (see error()). The
  /// view lives until the next call of any member.
  [[nodiscard]] bool next_line(std::string_view& line);
  /// The next n bytes, n <= kMaxLineBytes, or null where the data ends before or an error stands.
  [[nodiscard]] const std::byte* take(std::size_t n);
  /// The line next_line() gave last, counted from 1.
  [[nodiscard]] std::int64_t line_number() const noexcept { return line_; }
  /// Bytes left to give, where the source knows.
  [[nodiscard]] std::optional<std::uint64_t> remaining() const;
  [[nodiscard]] double fraction() const { return source_.fraction(); }
  /// The source's error or that of an endless line; empty while all is well.
  [[nodiscard]] const std::optional<Error>& error() const noexcept { return error_; }
  /// error() if there is one, else `otherwise` with the present line.
  [[nodiscard]] Error error_or(Error otherwise) const;

 private:
  bool refill();
  bool without_mark(std::string_view& first_line);

  ByteSource& source_;
  std::vector<char> buffer_;
  std::size_t begin_ = 0;
  std::size_t end_ = 0;
  std::int64_t line_ = 0;
  char line_end_ = '\n';
  bool ended_ = false;
  std::optional<Error> error_;
};

}  // namespace palpate::io
