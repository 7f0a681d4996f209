// Files that are written completely or not at all: written beside the final name, then renamed.
#pragma once

#include <cstddef>
#include <cstdio>
#include <memory>
#include <span>
#include <string>
#include <string_view>

#include <palpate/result.h>
#include <palpate/stop_callback.h>

namespace palpate {

/// Writes PATH.part. commit() renames it to PATH, replacing any file; destruction without commit(), or a stop
/// of the program, removes it. After an Error nothing more is written and commit() returns that Error.
/// Movable, not thread-safe. A second writer of the path, in any process, is refused.
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
  AtomicFile(std::string path, std::FILE* file, StopCallback stop_callback)
      : path_(std::move(path)), file_(file), stop_callback_(std::move(stop_callback)) {}
  void discard() noexcept;
  Error fail(const char* doing);

  std::string path_;
  std::unique_ptr<std::FILE, Close> file_;  ///< null once committed, discarded or moved from
  StopCallback stop_callback_;
  Error error_{};
};

/// Writes a small file at once.
Status write_file(const std::string& path, std::string_view text);

}  // namespace palpate
