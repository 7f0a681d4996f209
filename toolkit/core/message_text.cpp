#include "toolkit/core/message_text.h"

#include <fmt/format.h>

#include <algorithm>

namespace palpate {
namespace {

/// Edit distance with swaps of adjacent letters (Damerau 1964, no edits inside a swap).
std::size_t edits(std::string_view a, std::string_view b) {
  std::vector<std::vector<std::size_t>> d(a.size() + 1, std::vector<std::size_t>(b.size() + 1));
  for (std::size_t i = 0; i <= a.size(); ++i) d[i][0] = i;
  for (std::size_t j = 0; j <= b.size(); ++j) d[0][j] = j;
  for (std::size_t i = 1; i <= a.size(); ++i) {
    for (std::size_t j = 1; j <= b.size(); ++j) {
      const std::size_t replaced = d[i - 1][j - 1] + (a[i - 1] == b[j - 1] ? 0 : 1);
      d[i][j] = std::min({d[i - 1][j] + 1, d[i][j - 1] + 1, replaced});
      if (i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1])
        d[i][j] = std::min(d[i][j], d[i - 2][j - 2] + 1);
    }
  }
  return d[a.size()][b.size()];
}

constexpr std::size_t kLongestName = 64;     // longer words are not misspelt keys
constexpr std::size_t kEditsPerLetters = 3;  // up to one wrong letter in three

}  // namespace

std::string shown(std::string_view token) {
  constexpr std::size_t kShown = 40;  // enough to find it in an editor
  std::string text = "'";
  for (const char c : token.substr(0, kShown)) text += c >= ' ' && c < 0x7F ? c : '?';
  return text + (token.size() > kShown ? "..'" : "'");
}

std::string joined(const std::vector<std::string>& words, std::string_view between) {
  return fmt::format("{}", fmt::join(words, between));
}

std::string nearest_name(std::string_view wrong, const std::vector<std::string>& known) {
  if (wrong.size() > kLongestName) return {};
  std::string best;
  std::size_t fewest = wrong.size() / kEditsPerLetters + 1;
  for (const std::string& name : known) {
    const std::size_t distance = edits(wrong, name);
    // A prefix of a known name ("stiffness" for "stiffness_n_per_mm") matches, whatever is missing.
    const bool begins = wrong.size() > 2 && name.substr(0, wrong.size()) == wrong;
    if (distance < fewest || (begins && best.empty())) {
      best = name;
      fewest = std::min(distance, fewest);
    }
  }
  return best;
}

std::string did_you_mean(std::string_view wrong, const std::vector<std::string>& known,
                         std::string_view otherwise) {
  const std::string near = nearest_name(wrong, known);
  return near.empty() ? std::string(otherwise) : "did you mean '" + near + "'?";
}

}  // namespace palpate
