// Words that came from outside, in messages: shown in short, and what was probably meant by one that is not
// known.
#pragma once

#include <algorithm>
#include <iterator>
#include <ranges>
#include <string>
#include <string_view>
#include <vector>

namespace palpate {

/// A token for a message: in quotes, shortened, without control characters.
[[nodiscard]] std::string shown(std::string_view token);

/// "a, b, c".
[[nodiscard]] std::string joined(const std::vector<std::string>& words, std::string_view between = ", ");

/// The names of things that have a `name`.
template <std::ranges::range Things>
[[nodiscard]] std::vector<std::string> names_of(const Things& things) {
  std::vector<std::string> names;
  std::ranges::transform(things, std::back_inserter(names), [](const auto& thing) { return thing.name; });
  return names;
}

/// The name among `known` with the fewest edits to `wrong`, or empty where none is near (at most a third of
/// its letters differ).
[[nodiscard]] std::string nearest_name(std::string_view wrong, const std::vector<std::string>& known);

/// "did you mean 'cloud'?", or where none is near `otherwise`.
[[nodiscard]] std::string did_you_mean(std::string_view wrong, const std::vector<std::string>& known,
                                       std::string_view otherwise);

}  // namespace palpate
