// Selects the models that a frame processes: those that the broad phase reports near the HIP, those in
// contact, and those outside their known box.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <utility>
#include <vector>

#include "toolkit/render/scene_broad_phase.h"

namespace palpate::render {

/// Validity of a broad-phase answer when models move: it is renewed 50 times a second.
inline constexpr double kBroadPhaseHorizonS = 0.02;

/// Only build() allocates. Belongs to the frame thread.
class NearModels {
 public:
  void build(std::vector<ModelBox> boxes) {
    const std::size_t count = boxes.size();
    boxes_ = std::make_unique<SceneBroadPhase>(std::move(boxes), kBroadPhaseHorizonS);
    near_.reserve(count);
    previous_list_.reserve(count);
    candidates_.reserve(count);
    listed_.assign(count, 0);
    always_.reserve(count);
    always_.clear();
    built_always_count_ = 0;
  }
  /// Before the first reset(): model i is processed in every frame, however far its prepared box is.
  void mark_always_near(std::uint32_t index) {
    keep_near(index);
    built_always_count_ = always_.size();
  }
  /// The same until the next reset(), for a model whose points left its box.
  void keep_near(std::uint32_t index) noexcept {
    if (std::find(always_.begin(), always_.end(), index) == always_.end()) always_.push_back(index);
  }
  [[nodiscard]] bool built() const noexcept { return boxes_ != nullptr; }
  [[nodiscard]] std::size_t bytes() const noexcept {
    return boxes_ == nullptr ? 0 : boxes_->bytes() + listed_.capacity() * sizeof(listed_[0]);
  }

  /// The HIP is free at `hip_mm` at `t_s`. Enter: see choose().
  template <class Enter>
  void restart(const Vec3& hip_mm, double t_s, Enter&& enter) noexcept {
    previous_ = hip_mm;
    previous_s_ = t_s;
    if (boxes_ == nullptr) return;
    list_count_ = 1;
    near_.clear();
    always_.resize(built_always_count_);
    listed_.assign(listed_.size(), 0);
    ask(hip_mm, hip_mm, t_s, enter, [](std::uint32_t) { return false; });
  }
  /// The HIP continues from `hip_mm`; all contacts were released there.
  void release_contact(const Vec3& hip_mm) noexcept { previous_ = hip_mm; }

  /// Before a frame at `hip_mm`. enter(i, hip, t): model i comes near and was outside contact until then;
  /// touching(i): it is in contact and stays, however far the HIP went through it. O(log n + models listed);
  /// a jumping HIP lists the models on its way.
  template <class Enter, class Touching>
  void choose(const Vec3& hip_mm, double now_s, Enter&& enter, Touching&& touching) noexcept {
    const NearbyModels& near = boxes_->newest();
    // A model that changed its motion may be anywhere, so the answer is dropped.
    if (!single_frame_ && near.motion_version == boxes_->motion_version() && near.covers(previous_, now_s) &&
        near.covers(hip_mm, now_s))
      return;
    ask(previous_, hip_mm, now_s, enter, touching);
  }
  [[nodiscard]] std::span<const std::uint32_t> models() const noexcept { return near_; }
  /// After the frame.
  void done(const Vec3& hip_mm, double now_s) noexcept {
    previous_ = hip_mm;
    previous_s_ = now_s;
  }

 private:
  /// Models on a jump's way are listed for this frame only: they are not neighbours of its end.
  template <class Enter, class Touching>
  void ask(const Vec3& from_mm, const Vec3& to_mm, double now_s, Enter&& enter,
           Touching&& touching) noexcept {
    single_frame_ = boxes_->is_jump(from_mm, to_mm);
    if (single_frame_) {
      boxes_->move_to(now_s);
      boxes_->along_segment(from_mm, to_mm, candidates_);
      list(candidates_, enter, touching);
      return;
    }
    boxes_->run(now_s, from_mm, to_mm);
    take_answer(boxes_->newest(), enter, touching);
  }
  /// Takes over a broad-phase answer; falls back to the boxes when it overflows.
  template <class Enter, class Touching>
  void take_answer(const NearbyModels& found, Enter&& enter, Touching&& touching) noexcept {
    if (!found.too_many) {
      list({found.model.data(), found.count}, enter, touching);
      return;
    }
    boxes_->within(found.valid, candidates_);
    list(candidates_, enter, touching);
  }
  template <class Enter, class Touching>
  void list(std::span<const std::uint32_t> named, Enter&& enter, Touching&& touching) noexcept {
    ++list_count_;
    previous_list_.swap(near_);
    near_.clear();
    const auto take = [&](std::uint32_t index) {
      if (listed_[index] + 1 != list_count_) enter(index, previous_, previous_s_);
      listed_[index] = list_count_;
      near_.push_back(index);
    };
    for (const std::uint32_t index : named) take(index);
    for (const std::uint32_t index : previous_list_)
      if (touching(index) && listed_[index] != list_count_) take(index);
    for (const std::uint32_t index : always_)
      if (listed_[index] != list_count_) take(index);
  }

  std::unique_ptr<SceneBroadPhase> boxes_;
  std::vector<std::uint32_t> near_, previous_list_;  ///< current and previous models; room for all
  std::vector<std::uint32_t> candidates_;            ///< last candidates from the boxes; room for all
  std::vector<std::uint64_t> listed_;   ///< per model: the last broad-phase answer that listed it
  std::vector<std::uint32_t> always_;   ///< models processed everywhere; room for all
  std::size_t built_always_count_ = 0;  ///< number of these at build
  std::uint64_t list_count_ = 1;        ///< broad-phase answers taken over; 1 = none
  bool single_frame_ = false;           ///< near_ holds for its own frame only
  Vec3 previous_ = Vec3::Zero();        ///< last HIP, world
  double previous_s_ = 0.0;
};

}  // namespace palpate::render
