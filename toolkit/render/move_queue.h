// Moves of points from a slower deformer to the frames: the second arrangement of section 2.2.2.3, where the
// deformation is computed beside the haptic loop. The frame applies a batch before it collides, so contact
// points do not move between collision and response.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>

#include "toolkit/core/handover.h"
#include "toolkit/core/vec.h"

namespace palpate::render {

/// Moves handed over at once: some 100 us of work for the frame that applies them.
inline constexpr std::size_t kMaxBatch = 512;

/// New positions of points of the cloud, local to its origin, mm.
struct MoveBatch {
  std::uint64_t number = 0;
  std::uint32_t count = 0;
  std::array<std::uint32_t, kMaxBatch> point{};
  std::array<Vec3f, kMaxBatch> to_mm{};
};

/// One thread computes, one applies; no lock, no loss: a batch is published when the last has been taken.
class MoveQueue {
 public:
  /// Computing thread: the batch to fill, or null while the last one waits to be taken.
  [[nodiscard]] MoveBatch* begin() noexcept {
    if (taken_.load(std::memory_order_acquire) != published_) return nullptr;
    MoveBatch& batch = handover_.back();
    batch.count = 0;
    return &batch;
  }
  void publish() noexcept {
    handover_.back().number = ++published_;
    handover_.publish();
  }
  /// Frame thread: the next batch, or null. It stays as it is until the next call.
  [[nodiscard]] const MoveBatch* take() noexcept {
    if (!handover_.acquire()) return nullptr;
    taken_.store(handover_.front().number, std::memory_order_release);
    return &handover_.front();
  }

 private:
  Handover<MoveBatch> handover_;
  std::uint64_t published_ = 0;  // the computing thread's
  std::atomic<std::uint64_t> taken_{0};
};

}  // namespace palpate::render
