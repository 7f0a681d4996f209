#include "device/links/newest_command.h"

#include <algorithm>

namespace palpate::device {

bool NewestCommand::put(std::span<const std::uint8_t> bytes) noexcept {
  if (bytes.empty() || bytes.size() > CommandBytes::kMost) return false;
  for (int i = 0; i < kSlots; ++i) {
    Slot& slot = slots_[static_cast<std::size_t>(i)];
    if (slot.held.exchange(true, std::memory_order_acquire)) continue;
    std::copy(bytes.begin(), bytes.end(), slot.command.bytes.begin());
    slot.command.size = bytes.size();
    const int before = newest_.exchange(i, std::memory_order_seq_cst);
    if (before >= 0) {
      slots_[static_cast<std::size_t>(before)].held.store(false, std::memory_order_release);
      replaced_.fetch_add(1, std::memory_order_relaxed);
    }
    return true;
  }
  return false;
}

bool NewestCommand::take(CommandBytes& into) noexcept {
  const int newest = newest_.exchange(-1, std::memory_order_seq_cst);
  if (newest < 0) return false;
  Slot& slot = slots_[static_cast<std::size_t>(newest)];
  into = slot.command;
  slot.held.store(false, std::memory_order_release);
  return true;
}

}  // namespace palpate::device
