#include "experiments/session/version.h"

namespace palpate::experiments {

std::string version_text() {
  return PALPATE_VERSION;
}
std::string build_text() {
  return PALPATE_BUILD;
}
std::string flags_text() {
  return PALPATE_FLAGS;
}

}  // namespace palpate::experiments
