// Text rules for files: lengths, links, machine paths.
#pragma once

#include <functional>
#include <string>
#include <string_view>
#include <vector>

namespace palpate::house {

/// Longer files are split, or say why not near their head ("Over 500 lines: ...").
inline constexpr std::size_t kMaxLines = 500;
inline constexpr std::size_t kHeadLines = 10;  ///< the reason must be in these lines

/// True if a source file is short enough or gives its reason.
[[nodiscard]] bool length_is_fine(const std::vector<std::string>& lines);

/// Link and image targets of a Markdown text within the project: no web or mail addresses.
[[nodiscard]] std::vector<std::string> internal_links(std::string_view markdown);

/// Anchors of a Markdown text's headings ("## The frame path" -> "the-frame-path").
[[nodiscard]] std::vector<std::string> anchors(std::string_view markdown);

/// Why link `target` in `file` is broken; empty if valid. `read` gives a file's text.
[[nodiscard]] std::string broken_link(const std::string& file, const std::string& target,
                                      const std::function<bool(const std::string& path)>& exists,
                                      const std::function<std::string(const std::string& path)>& read);

/// True if a line opens a file for reading without toolkit/core/input_file.h, which alone refuses pipes and
/// devices. System files are exempt.
[[nodiscard]] bool opens_a_file(const std::string& line);

/// True if a line names a machine path or a package registry's host.
[[nodiscard]] bool names_a_machine(const std::string& line);

}  // namespace palpate::house
