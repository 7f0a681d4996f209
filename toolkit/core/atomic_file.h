// Output that is either whole or not there: written beside its final name and renamed when complete.
#pragma once

#include <cstddef>
#include <cstdio>
#include <memory>
#include <span>
#include <string>
#include <string_view>

#include "toolkit/core/at_stop.h"
#include "toolkit/core/result.h"

namespace palpate {

/// Writes to PATH.part; commit() makes it PATH (replacing what was there), destruction without commit() and a
/// stop of the program remove it. After an Error nothing more is written and commit() fails with that same
/// Error. Movable, not thread-safe. One writer per path at a time: a second one, of any process, is refused.
class AtomicFile {
 public:
  /// The folder must exist.
  [[nodiscard]] static Result<AtomicFile> create(std::string path);
  AtomicFile(AtomicFile&&) noexcept = default;
  AtomicFile& operator=(AtomicFile&& other) noexcept;
  ~AtomicFile();

  Status write(std::string_view text);
  Status write(std::span<const std::byte> data);
  /// Flushes to the disk, closes and renames.
  Status commit();
  [[nodiscard]] const std::string& path() const noexcept { return path_; }

 private:
  struct Close {
    void operator()(std::FILE* file) const noexcept { std::fclose(file); }
  };
  AtomicFile(std::string path, std::FILE* file, AtStop at_stop)
      : path_(std::move(path)), file_(file), at_stop_(std::move(at_stop)) {}
  void discard() noexcept;
  Error fail(const char* doing);

  std::string path_;
  std::unique_ptr<std::FILE, Close> file_;  ///< null once committed, discarded or moved from
  AtStop at_stop_;
  Error error_{};
};

/// The whole of a small file at once.
Status write_file(const std::string& path, std::string_view text);

}  // namespace palpate
