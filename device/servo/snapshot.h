// A value that another thread replaces while the servo uses it: the servo gets the newest by a pointer, and
// what it replaces is destroyed where it came from, never in the servo thread.
#pragma once

#include <memory>
#include <utility>

#include "toolkit/core/handover.h"

namespace palpate::device {

/// Exactly one thread publishes and one uses. T may be of any size; it is not copied. Only the publisher
/// allocates and destroys, the last value excepted, which goes with the Snapshot. Stands on Handover: its
/// three slots hold the owners, and a slot is only ever emptied while it is the publisher's.
template <class T>
class Snapshot {
 public:
  /// The user sees `initial` (may be null) until something is published and taken.
  explicit Snapshot(std::unique_ptr<T> initial = nullptr) : newest_(std::move(initial)), box_(newest_) {
    box_.back().reset();
    collect();  // the initial value does not outlive its use in a slot that nobody looks at
  }

  /// Publisher: the newest value from now on. What it replaces is destroyed as soon as the user has let go of
  /// it: here, or in the next publish or collect.
  void publish(std::unique_ptr<T> value) {
    newest_ = std::move(value);
    collect();
  }
  /// Publisher: destroys what the user has let go of since. Cheap; to be called now and then after a publish.
  void collect() {
    // Handing the newest over once more brings back the slot that the user gave up.
    box_.publish(newest_);
    box_.back().reset();
  }

  /// User: takes the newest. True where it is another than before. Wait-free; destroys nothing.
  bool acquire() noexcept {
    const T* const before = get();
    return box_.acquire() && get() != before;
  }
  /// User: what it took last; stays until the next acquire().
  [[nodiscard]] T* get() const noexcept { return box_.front().get(); }

 private:
  std::shared_ptr<T> newest_;  // the publisher's
  Handover<std::shared_ptr<T>> box_;
};

}  // namespace palpate::device
