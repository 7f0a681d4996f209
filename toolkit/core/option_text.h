// Options in words, for lists of them.
#pragma once

#include <string>

#include "toolkit/core/options.h"

namespace palpate {

/// "method=grid", "method other than none", "jitter": with what an option acts.
[[nodiscard]] std::string text_of(const OptionCondition& condition);

}  // namespace palpate
