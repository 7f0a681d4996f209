// Rules on the text of files: lengths, links, paths of one machine.
#pragma once

#include <functional>
#include <string>
#include <string_view>
#include <vector>

namespace palpate::house {

/// Longer files are split, or say why not near their head ("Over 500 lines: ...").
inline constexpr std::size_t kMaxLines = 500;
inline constexpr std::size_t kHeadLines = 10;  ///< where the reason may stand: the opening comment

/// True where a source file is short enough or gives its reason.
[[nodiscard]] bool length_is_fine(const std::vector<std::string>& lines);

/// Targets of the links and pictures in a Markdown text that point into the project: no address, no mail.
[[nodiscard]] std::vector<std::string> internal_links(std::string_view markdown);

/// The anchors that the headings of a Markdown text make ("## The frame path" -> "the-frame-path").
[[nodiscard]] std::vector<std::string> anchors(std::string_view markdown);

/// Why the link `target` in `file` leads nowhere; empty where it leads somewhere. `read` gives a file's text.
[[nodiscard]] std::string broken_link(const std::string& file, const std::string& target,
                                      const std::function<bool(const std::string& path)>& exists,
                                      const std::function<std::string(const std::string& path)>& read);

/// True where a line of code opens a file to read it other than by toolkit/core/input_file.h, which alone
/// refuses pipes and devices. The system's own files are no input.
[[nodiscard]] bool opens_a_file(const std::string& line);

/// True where a line names a path of one machine or the host of a package registry.
[[nodiscard]] bool names_a_machine(const std::string& line);

}  // namespace palpate::house
