#include "experiments/live/homing_teller.h"

namespace palpate::experiments {

std::optional<std::string> HomingTeller::news() {
  std::string now = device_.homing_prompt();
  if (now == told_) return std::nullopt;
  told_ = std::move(now);
  if (told_.empty()) return "the device knows its zero" + then_;
  return "the device does not know its zero yet, and shows no force. " + told_ + ".";
}

}  // namespace palpate::experiments
