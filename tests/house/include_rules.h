// Which file may include which. docs/how-to/change-palpate.md draws the same picture for people.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace palpate::house {

/// Path of an #include line ("palpate/vec.h", "CGAL/Kernel.h"); nothing for other lines.
[[nodiscard]] std::optional<std::string> included_path(std::string_view line);

/// "palpate/vec.h" of "toolkit/include/palpate/vec.h"; empty if not a public header.
[[nodiscard]] std::string public_name(const std::string& file);
/// Public headers as an application includes them, sorted.
[[nodiscard]] std::vector<std::string> public_headers();
/// Why a line is not allowed in a public header, which includes only public ones, the standard library and
/// Eigen; empty if allowed.
[[nodiscard]] std::string leak(std::string_view line);

/// Why `file` (relative to the root) must not include `path`; empty if allowed.
[[nodiscard]] std::string forbidden(const std::string& file, const std::string& path);

}  // namespace palpate::house
