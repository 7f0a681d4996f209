// What the readers of all formats share: bounds on promises, faces, progress. Internal to toolkit/io and
// toolkit/pcd.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include <palpate/read_model.h>
#include "toolkit/io/buffered_input.h"
#include "toolkit/io/decoded_file.h"

namespace palpate::io {

/// Indices are 32 bits wide and the last value marks a dropped point.
inline constexpr std::uint64_t kMaxPoints = 0xFFFFFFFEu;
/// Rows between two reports of progress: about a hundredth of a second of parsing.
inline constexpr std::uint64_t kRowsPerReport = std::uint64_t{1} << 16;
/// Points for which memory is reserved on the word of a header alone (24 MB); beyond that it grows with what
/// arrives.
inline constexpr std::uint64_t kMaxReservedPoints = std::uint64_t{1} << 20;

/// An Error if `count` things of `bytes_each` in memory pass the bound of the options.
[[nodiscard]] Status check_memory(std::uint64_t count, std::uint64_t bytes_each, std::string_view what,
                                  const ReadOptions& options);
/// How many of `count` promised rows of at least `min_row_bytes` to reserve for.
[[nodiscard]] std::size_t reserve_count(std::uint64_t count, std::uint64_t min_row_bytes,
                                        std::optional<std::uint64_t> remaining);

/// Reports progress, asks whether to stop and watches memory, once every kRowsPerReport rows.
class ReadMonitor {
 public:
  ReadMonitor(const ReaderInput& input, const BufferedInput& buffer, const DecodedFile& decoded);
  /// Call once a row. False: stop, error() says why.
  [[nodiscard]] bool row() { return ++rows_ % kRowsPerReport != 0 || check(); }
  [[nodiscard]] const Error& error() const noexcept { return error_; }

 private:
  bool check();
  const ReaderInput& input_;
  const BufferedInput& buffer_;
  const DecodedFile& decoded_;
  std::uint64_t rows_ = 0;
  Error error_;
};

/// Takes polygons corner by corner and leaves fans of triangles in a DecodedFile. A polygon with an index
/// below 0 or at or above `index_limit`, or with fewer than three corners, is dropped whole and counted.
class FaceBuilder {
 public:
  FaceBuilder(DecodedFile& decoded, std::uint64_t index_limit, const ReadOptions& options);
  void begin() noexcept;
  /// False where the triangles pass the memory bound: give up with too_many().
  [[nodiscard]] bool corner(std::int64_t index);
  void end();
  [[nodiscard]] Error too_many() const;

 private:
  DecodedFile& decoded_;
  std::uint64_t index_limit_;
  std::uint64_t max_bytes_;
  std::uint64_t max_triangles_;
  std::size_t start_ = 0;
  std::uint64_t corners_ = 0;
  std::uint32_t first_ = 0;
  std::uint32_t last_ = 0;
  bool bad_ = false;
};

/// Readers of one format each.
[[nodiscard]] Result<DecodedFile> read_ply(const ReaderInput& input);
[[nodiscard]] Result<DecodedFile> read_xyz(const ReaderInput& input);
[[nodiscard]] Result<DecodedFile> read_obj(const ReaderInput& input);
[[nodiscard]] Result<DecodedFile> read_off(const ReaderInput& input);
[[nodiscard]] Result<DecodedFile> read_pfm(const ReaderInput& input);

}  // namespace palpate::io
