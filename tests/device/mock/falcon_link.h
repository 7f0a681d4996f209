// A link to a board without USB, on a virtual clock that every pause moves.
#pragma once

#include <algorithm>
#include <vector>

#include <palpate/clock.h>
#include <palpate/device/link.h>
#include "tests/device/mock/falcon_board.h"

namespace palpate::device {

class FalconLink final : public ControlLink {
 public:
  FalconLink(FalconBoard& board, const Clock& clock) : board_(board), clock_(clock) {}

  Status open() override {
    if (unplugged) return Error{"no device 0403:cb48 is connected by USB", "plug it in", "falcon"};
    open_ = true;
    ++opens;
    left_.clear();
    return Done{};
  }
  void close() noexcept override { open_ = false; }
  bool submit(std::span<const std::uint8_t> bytes) noexcept override {
    if (!open_ || unplugged || jammed) return false;
    board_.out(bytes, clock_.now_ns());
    return true;
  }
  Polled poll(std::span<std::uint8_t> into) noexcept override {
    if (!open_ || unplugged) return {0, true};
    if (left_.empty())
      if (auto packet = board_.in(clock_.now_ns())) left_ = *std::move(packet);
    const std::size_t size = std::min(into.size(), left_.size());
    std::copy_n(left_.begin(), size, into.begin());
    left_.erase(left_.begin(), left_.begin() + static_cast<std::ptrdiff_t>(size));
    return {size, false};
  }
  Status control(const ControlRequest& request) override {
    if (!open_ || unplugged) return Error{"a control request failed: the device is gone", "", "falcon"};
    board_.control(request, clock_.now_ns());
    controls.push_back(request);
    return Done{};
  }

  bool unplugged = false, jammed = false;
  int opens = 0;
  std::vector<ControlRequest> controls;

 private:
  FalconBoard& board_;
  const Clock& clock_;
  bool open_ = false;
  std::vector<std::uint8_t> left_;
};

}  // namespace palpate::device
