// Which file may include which. docs/architecture.md draws the same picture for people.
#pragma once

#include <optional>
#include <string>
#include <string_view>

namespace palpate::house {

/// The path that an #include line names ("toolkit/core/vec.h", "CGAL/Kernel.h"), or nothing for any other
/// line.
[[nodiscard]] std::optional<std::string> included_path(std::string_view line);

/// Why `file` (relative to the root) may not include `path`; empty where it may.
[[nodiscard]] std::string forbidden(const std::string& file, const std::string& path);

}  // namespace palpate::house
