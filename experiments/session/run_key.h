// What the results of a run depend on, as one word.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "experiments/run/arguments.h"
#include "toolkit/core/hash.h"

namespace palpate::experiments {

/// A run goes on from an interrupted one only where the two have the same key: the same program on the same
/// machine, and everything that was added. Not for security.
class RunKey {
 public:
  RunKey();
  RunKey& add(std::string_view text);
  RunKey& add(double value);
  RunKey& add(std::uint64_t value);
  /// Name and content; a file that cannot be read counts as empty.
  RunKey& add_file(const std::string& path);
  [[nodiscard]] std::string word() const { return hash_.hex(); }

 private:
  Hash64 hash_;
};

/// What the results of one renderer depend on besides.
[[nodiscard]] std::string key_of(const RendererRequest& request);

}  // namespace palpate::experiments
