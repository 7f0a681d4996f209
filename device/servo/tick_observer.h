// Who wants to see every tick of a servo: recorders, histograms, a window.
#pragma once

#include "device/servo/servo.h"

namespace palpate::device {

class TickObserver {
 public:
  TickObserver() = default;
  TickObserver(const TickObserver&) = delete;
  TickObserver& operator=(const TickObserver&) = delete;
  virtual ~TickObserver() = default;

  /// In the servo thread, after the force was sent. Never blocks, allocates, locks or logs: what it cannot
  /// keep it counts as lost.
  virtual void took(const Tick& tick) noexcept = 0;
};

}  // namespace palpate::device
