// What fuzz targets must find: otherwise the input is a finding. So short, as all of them share this alone.
#pragma once

#include <cstdlib>

namespace palpate {

inline void must(bool sound) {
  if (!sound) std::abort();
}

}  // namespace palpate
