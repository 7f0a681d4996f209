// Which of a scene's models a frame looks at: those that the broad phase names near the HIP, those that
// are touched, and those that do not keep to the box that it knows.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <utility>
#include <vector>

#include "toolkit/render/scene_boxes.h"

namespace palpate::render {

/// An answer of the broad phase holds for so long where models move: 50 times a second it is asked again.
inline constexpr double kHorizonS = 0.02;

/// Only build() allocates. Belongs to the thread of the frames.
class NearModels {
 public:
  void build(std::vector<ModelBox> boxes) {
    const std::size_t count = boxes.size();
    boxes_ = std::make_unique<SceneBoxes>(std::move(boxes), kHorizonS);
    near_.reserve(count);
    former_.reserve(count);
    met_.reserve(count);
    listed_.assign(count, 0);
    always_.reserve(count);
    always_.clear();
    built_always_ = 0;
  }
  /// Before the first reset(): model i is looked at in every frame, however far its prepared box is.
  void always_near(std::uint32_t index) {
    keep_near(index);
    built_always_ = always_.size();
  }
  /// The same from now to the next reset(): its points have left the box.
  void keep_near(std::uint32_t index) noexcept {
    if (std::find(always_.begin(), always_.end(), index) == always_.end()) always_.push_back(index);
  }
  [[nodiscard]] bool built() const noexcept { return boxes_ != nullptr; }
  [[nodiscard]] std::size_t bytes() const noexcept {
    return boxes_ == nullptr ? 0 : boxes_->bytes() + listed_.capacity() * sizeof(listed_[0]);
  }

  /// Enter: see choose(). The HIP is free at `hip_mm` at `t_s`.
  template <class Enter>
  void restart(const Vec3& hip_mm, double t_s, Enter&& enter) noexcept {
    previous_ = hip_mm;
    previous_s_ = t_s;
    if (boxes_ == nullptr) return;
    lists_ = 1;
    near_.clear();
    always_.resize(built_always_);
    listed_.assign(listed_.size(), 0);
    ask(hip_mm, hip_mm, t_s, enter, [](std::uint32_t) { return false; });
  }
  /// The HIP goes on from `hip_mm`; every model's contact has been told so.
  void let_go(const Vec3& hip_mm) noexcept { previous_ = hip_mm; }

  /// Before a frame at `hip_mm`. enter(i, hip, t): model i comes near, and was clear of the HIP up to there
  /// and then; touching(i): it is in contact, and stays however far the HIP has gone through it. O(log n +
  /// models listed): of a HIP that jumps, those on its way.
  template <class Enter, class Touching>
  void choose(const Vec3& hip_mm, double now_s, Enter&& enter, Touching&& touching) noexcept {
    const NearbyModels& near = boxes_->newest();
    // A model that took another course since may be anywhere near the HIP: the answer is dropped.
    if (!once_ && near.courses == boxes_->courses() && near.covers(previous_, now_s) &&
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
  /// What lay along a jump is no neighbour afterwards, and the box around it holds models
  /// that are nowhere near: of a jump those on the way are listed, for this one frame.
  template <class Enter, class Touching>
  void ask(const Vec3& from_mm, const Vec3& to_mm, double now_s, Enter&& enter,
           Touching&& touching) noexcept {
    once_ = boxes_->is_jump(from_mm, to_mm);
    if (once_) {
      boxes_->move_to(now_s);
      boxes_->on_way(from_mm, to_mm, met_);
      list(met_, enter, touching);
      return;
    }
    boxes_->run(now_s, from_mm, to_mm);
    take_answer(boxes_->newest(), enter, touching);
  }
  /// Takes over an answer of the broad phase. Of too many models the boxes tell.
  template <class Enter, class Touching>
  void take_answer(const NearbyModels& found, Enter&& enter, Touching&& touching) noexcept {
    if (!found.too_many) {
      list({found.model.data(), found.count}, enter, touching);
      return;
    }
    boxes_->within(found.valid, met_);
    list(met_, enter, touching);
  }
  template <class Enter, class Touching>
  void list(std::span<const std::uint32_t> named, Enter&& enter, Touching&& touching) noexcept {
    ++lists_;
    former_.swap(near_);
    near_.clear();
    const auto take = [&](std::uint32_t index) {
      if (listed_[index] + 1 != lists_) enter(index, previous_, previous_s_);
      listed_[index] = lists_;
      near_.push_back(index);
    };
    for (const std::uint32_t index : named) take(index);
    for (const std::uint32_t index : former_)
      if (touching(index) && listed_[index] != lists_) take(index);
    for (const std::uint32_t index : always_)
      if (listed_[index] != lists_) take(index);
  }

  std::unique_ptr<SceneBoxes> boxes_;
  std::vector<std::uint32_t> near_, former_;  ///< models looked at, and before; room for all
  std::vector<std::uint32_t> met_;            ///< what the boxes told last, where they tell; room for all
  std::vector<std::uint64_t> listed_;         ///< the last answer of the broad phase that named a model
  std::vector<std::uint32_t> always_;         ///< models near wherever the HIP is; room for all
  std::size_t built_always_ = 0;              ///< so many of them from the start
  std::uint64_t lists_ = 1;                   ///< answers of the broad phase taken over, 1 = none
  bool once_ = false;                         ///< near_ is good for the frame it was made for alone
  Vec3 previous_ = Vec3::Zero();              ///< the HIP of the last frame, world
  double previous_s_ = 0.0;
};

}  // namespace palpate::render
