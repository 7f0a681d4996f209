// The folder of a run's results.
#pragma once

#include <filesystem>
#include <string>
#include <string_view>

#include "toolkit/core/result.h"

namespace palpate::experiments {

/// Marks a folder as Palpate's: only there are results replaced.
inline constexpr const char* kFolderMark = ".palpate-output";

class OutputFolder {
 public:
  /// Makes the folder, with its parents, where it is missing. A folder that holds something but no mark of an
  /// earlier run is refused: its files are somebody else's. The old result.json and report.html go at once,
  /// so that an interrupted run does not look whole.
  [[nodiscard]] static Result<OutputFolder> open(const std::string& folder);

  [[nodiscard]] std::filesystem::path file(const std::string& name) const { return folder_ / name; }
  [[nodiscard]] const std::filesystem::path& path() const noexcept { return folder_; }
  /// A folder inside, made where missing.
  [[nodiscard]] Result<OutputFolder> inside(const std::string& name) const;
  /// Whole or not at all.
  [[nodiscard]] Status write(const std::string& name, std::string_view text) const;

 private:
  explicit OutputFolder(std::filesystem::path folder) : folder_(std::move(folder)) {}
  std::filesystem::path folder_;
};

}  // namespace palpate::experiments
