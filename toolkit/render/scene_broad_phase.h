// The broad phase: which models the HIP may meet until the next query. It finds candidates now and then, and
// frames test only these (structure of reference [77]).
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <vector>

#include <palpate/aabb.h>
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

}  // namespace palpate::render
