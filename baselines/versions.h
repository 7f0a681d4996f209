// Which libraries the rivals stand on: their times are theirs as well.
#pragma once

#include <string>
#include <utility>
#include <vector>

namespace palpate::baselines {

/// Name and version of every library that does a rival's work, as this program found them when it was
/// compiled.
[[nodiscard]] std::vector<std::pair<std::string, std::string>> library_versions();

}  // namespace palpate::baselines
