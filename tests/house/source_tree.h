// The project's own files, for the tests that read them.
#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

namespace palpate::house {

/// The root of the checkout.
[[nodiscard]] std::filesystem::path source_root();

/// Every file of the project below the root, relative to it with forward slashes, sorted. Build folders,
/// results and hidden folders other than .ci are left out.
[[nodiscard]] std::vector<std::string> project_files();

/// The lines of a file of the project, without their ends.
[[nodiscard]] std::vector<std::string> lines_of(const std::string& file);
[[nodiscard]] std::string text_of(const std::string& file);

[[nodiscard]] bool is_source(const std::string& file);    ///< .h or .cpp
[[nodiscard]] bool is_markdown(const std::string& file);  ///< .md

/// Runs `check(file, lines)` over the files that `wanted` takes and joins what it finds. For EXPECT_EQ(..,
/// "").
[[nodiscard]] std::string findings_over(
    const std::function<bool(const std::string&)>& wanted,
    const std::function<std::string(const std::string& file, const std::vector<std::string>& lines)>& check);

}  // namespace palpate::house
