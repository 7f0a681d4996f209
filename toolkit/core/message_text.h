// Foreign words in messages: shown shortened, with suggestions for unknown names.
#pragma once

#include <algorithm>
#include <iterator>
#include <ranges>
#include <string>
#include <string_view>
#include <vector>

namespace palpate {

/// A token in quotes, shortened, without control characters.
[[nodiscard]] std::string shown(std::string_view token);

/// "a, b, c".
[[nodiscard]] std::string joined(const std::vector<std::string>& words, std::string_view between = ", ");

/// The names of things with a `name`.
template <std::ranges::range Things>
[[nodiscard]] std::vector<std::string> names_of(const Things& things) {
  std::vector<std::string> names;
  std::ranges::transform(things, std::back_inserter(names), [](const auto& thing) { return thing.name; });
  return names;
}

/// The name in `known` with the fewest edits to `wrong`; empty if over a third of its letters differ.
[[nodiscard]] std::string nearest_name(std::string_view wrong, const std::vector<std::string>& known);

/// "did you mean 'cloud'?", or `otherwise` if none is near.
[[nodiscard]] std::string did_you_mean(std::string_view wrong, const std::vector<std::string>& known,
                                       std::string_view otherwise);

}  // namespace palpate
