// An Error without a file, in one call.
#pragma once

#include <string>
#include <utility>

#include <palpate/result.h>

namespace palpate::baselines {

[[nodiscard]] inline Error failure(std::string what, std::string remedy = {}) {
  return {std::move(what), std::move(remedy), {}, 0};
}

}  // namespace palpate::baselines
