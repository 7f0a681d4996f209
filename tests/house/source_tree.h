// The project's files, for tests that read them.
#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

namespace palpate::house {

[[nodiscard]] std::filesystem::path source_root();

/// All files below the root, relative to it with forward slashes, sorted. Excludes build folders, results and
/// hidden folders other than .ci.
[[nodiscard]] std::vector<std::string> project_files();

[[nodiscard]] std::vector<std::string> lines_of(const std::string& file);
[[nodiscard]] std::string text_of(const std::string& file);

[[nodiscard]] bool is_source(const std::string& file);    ///< .h or .cpp
[[nodiscard]] bool is_markdown(const std::string& file);  ///< .md

/// "file:line: finding" for each line of the files accepted by `wanted` in which `check` finds something.
[[nodiscard]] std::string findings_by_line(
    const std::function<bool(const std::string&)>& wanted,
    const std::function<std::string(const std::string& file, const std::string& line)>& check);

/// Runs `check(file, lines)` over the files accepted by `wanted` and joins the findings, for EXPECT_EQ(..,
/// "").
[[nodiscard]] std::string findings_over(
    const std::function<bool(const std::string&)>& wanted,
    const std::function<std::string(const std::string& file, const std::vector<std::string>& lines)>& check);

}  // namespace palpate::house
