// The models that a frame processes: those that the broad phase reports near the HIP, those in contact, and
// those outside their known box. The broad phase finds candidates now and then, and frames test only these
// (structure of reference [77]).
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <utility>
#include <vector>

#include <palpate/geometry.h>
#include <palpate/motion.h>
#include "toolkit/geometry/broad_phase.h"

namespace palpate::render {

/// Most models in an answer. A fuller answer says so, and the frame queries its own way instead.
inline constexpr std::size_t kMaxNearbyModels = 32;

/// The models whose boxes meet `valid` at any time up to `until_s`. No other can be touched while the HIP
/// stays inside and no model changes its motion.
struct NearbyModels {
  std::array<std::uint32_t, kMaxNearbyModels> model{};
  std::uint32_t count = 0;
  bool too_many = false;
  geometry::Aabb valid;
  double until_s = -1.0;
  std::uint64_t motion_version = 0;  ///< SceneBroadPhase::motion_version(), read before the poses

  [[nodiscard]] bool covers(const Vec3& hip_mm, double t_s) const noexcept {
    return t_s <= until_s && valid.contains(hip_mm);
  }
};

/// A model's box, as known to the broad phase.
struct ModelBox {
  geometry::Aabb local_mm;  ///< includes the reach of its vertex boxes
  geometry::RigidTransform world_from_model;
  std::shared_ptr<MovingModel> motion;  ///< or null
};

/// Belongs to one thread.
class SceneBroadPhase {
 public:
  /// `horizon_s`: validity of an answer when models move; query at least that often.
  SceneBroadPhase(std::vector<ModelBox> models, double horizon_s);

  /// Searches around the way from `from_mm` to `to_mm`. O(log n + candidates) if nothing moves, else O(n).
  /// Allocates nothing.
  void run(double t_s, const Vec3& from_mm, const Vec3& to_mm) noexcept;
  /// Result of the last run().
  [[nodiscard]] const NearbyModels& newest() const noexcept { return found_; }
  /// The models near a segment, or in a region, at the time of the last run() or move_to(), by rising index.
  /// `out` must have room for all models.
  void along_segment(const Vec3& from_mm, const Vec3& to_mm, std::vector<std::uint32_t>& out) const noexcept {
    phase_.along_segment(from_mm, to_mm, margin_mm_, out);
  }
  void within(const geometry::Aabb& region, std::vector<std::uint32_t>& out) const noexcept {
    phase_.within(region, out);
  }
  /// Updates the boxes for along_segment(). O(n) if anything moves.
  void move_to(double t_s) noexcept;
  /// True for a way longer than an answer's reach; models along it are not neighbours of its end.
  [[nodiscard]] bool is_jump(const Vec3& from_mm, const Vec3& to_mm) const noexcept {
    return (to_mm - from_mm).cwiseAbs().maxCoeff() > margin_mm_;
  }
  /// Rises when any model changes its motion; answers with another number are invalid. Thread-safe.
  /// O(simulations).
  [[nodiscard]] std::uint64_t motion_version() const noexcept {
    std::uint64_t sum = 0;
    for (const std::shared_ptr<MotionVersion>& count : motion_version_)
      sum += count->load(std::memory_order_acquire);
    return sum;
  }
  [[nodiscard]] std::size_t bytes() const noexcept;

 private:
  [[nodiscard]] geometry::Aabb box_of(const ModelBox& model) const noexcept;

  std::vector<ModelBox> models_;
  std::vector<std::shared_ptr<MotionVersion>> motion_version_;  ///< of the moving models, without repetition
  double horizon_s_;
  double margin_mm_ = 0.0;  ///< reach of a list around the HIP
  bool moves_ = false;
  double t_s_ = 0.0;
  std::vector<geometry::Aabb> boxes_;
  geometry::BroadPhase phase_;
  NearbyModels found_;
};

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
