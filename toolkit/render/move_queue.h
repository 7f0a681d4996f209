// Moves of points from a slower deformer to the frames: the second arrangement of section 2.2.2.3, where the
// deformation is computed beside the haptic loop. The frame applies a batch before it collides, so contact
// points do not move between collision and response. The edits belong to the scene: every renderer on it
// reads all of them.
#pragma once

#include <algorithm>
#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "toolkit/core/handover.h"
#include "toolkit/core/vec.h"

namespace palpate::render {

/// Moves handed over at once: 0.25 to 0.8 ms of work for the frame that applies them, on a million points.
inline constexpr std::size_t kMaxBatch = 512;

/// New positions of points of the cloud, local to its origin, mm.
struct MoveBatch {
  std::uint64_t number = 0;
  std::uint32_t count = 0;
  std::array<std::uint32_t, kMaxBatch> point{};
  std::array<Vec3f, kMaxBatch> to_mm{};
};

/// What one renderer has still to apply. Belongs to the thread of its frames.
class MoveReader {
 public:
  /// The next batch, or null. It stays as it is until the next call. Wait-free.
  [[nodiscard]] const MoveBatch* take() noexcept {
    if (!handover_.acquire()) return nullptr;
    taken_.store(handover_.front().number, std::memory_order_release);
    return &handover_.front();
  }

 private:
  friend class MoveQueue;
  Handover<MoveBatch> handover_;
  std::atomic<std::uint64_t> taken_{0};
};

/// One thread computes, each reader applies; no lock, no loss: a batch is published when every reader has
/// taken the last. A reader whose renderer is prepared and never stepped holds the others up; one that is
/// gone does not.
class MoveQueue {
 public:
  /// A further reader: while renderers are prepared, before the computing thread goes on. It gets what is
  /// published from now on.
  [[nodiscard]] std::shared_ptr<MoveReader> subscribe() {
    auto reader = std::make_shared<MoveReader>();
    reader->taken_.store(published_, std::memory_order_relaxed);
    readers_.push_back(reader);
    return reader;
  }
  /// Computing thread: the batch to fill, or null while a reader has still to take the last one.
  [[nodiscard]] MoveBatch* begin() {
    std::erase_if(readers_,
                  [](const std::shared_ptr<MoveReader>& reader) { return reader.use_count() == 1; });
    const auto is_behind = [this](const std::shared_ptr<MoveReader>& reader) {
      return reader->taken_.load(std::memory_order_acquire) != published_;
    };
    if (std::any_of(readers_.begin(), readers_.end(), is_behind)) return nullptr;
    batch_.count = 0;
    return &batch_;
  }
  void publish() noexcept {
    batch_.number = ++published_;
    for (const std::shared_ptr<MoveReader>& reader : readers_) reader->handover_.publish(batch_);
  }

 private:
  std::vector<std::shared_ptr<MoveReader>> readers_;
  MoveBatch batch_;
  std::uint64_t published_ = 0;
};

}  // namespace palpate::render
