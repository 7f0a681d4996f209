// The broad phase: which models of a scene the HIP may meet until it is asked again (the structure of
// reference [77]: candidates are found now and then, a frame looks at these alone).
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <vector>

#include "toolkit/geometry/aabb.h"
#include "toolkit/geometry/broad_phase.h"
#include "toolkit/render/motion.h"

namespace palpate::render {

/// Models that an answer names; of more it says so, and the frame asks for those on its own way.
inline constexpr std::size_t kMaxNearbyModels = 32;

/// The models whose boxes meet `valid` at any time up to `until_s`: while the HIP stays inside and no model
/// takes another course, no other can be touched.
struct NearbyModels {
  std::array<std::uint32_t, kMaxNearbyModels> model{};
  std::uint32_t count = 0;
  bool too_many = false;
  geometry::Aabb valid;
  double until_s = -1.0;
  std::uint64_t courses = 0;  ///< SceneBoxes::courses() before the poses were read

  [[nodiscard]] bool covers(const Vec3& hip_mm, double t_s) const noexcept {
    return t_s <= until_s && valid.contains(hip_mm);
  }
};

/// What the broad phase knows of a model.
struct ModelBox {
  geometry::Aabb local_mm;  ///< with the reach of its boxes
  geometry::RigidTransform world_from_model;
  std::shared_ptr<MovingModel> motion;  ///< or null
};

/// Belongs to one thread.
class SceneBoxes {
 public:
  /// `horizon_s`: how long an answer holds where models move; to be asked at least so often.
  SceneBoxes(std::vector<ModelBox> models, double horizon_s);

  /// Looks around the way from `from_mm` to `to_mm`. O(log n +
  /// candidates) where nothing moves, O(n) where anything does. Allocates nothing.
  void run(double t_s, const Vec3& from_mm, const Vec3& to_mm) noexcept;
  /// What the last run() found.
  [[nodiscard]] const NearbyModels& newest() const noexcept { return found_; }
  /// The models that a HIP on that way comes near, at the time of the last run() or move_to(), or those of a
  /// region: any number of them, rising. `out` must have room for all models.
  void on_way(const Vec3& from_mm, const Vec3& to_mm, std::vector<std::uint32_t>& out) const noexcept {
    phase_.on_way(from_mm, to_mm, margin_mm_, out);
  }
  void within(const geometry::Aabb& region, std::vector<std::uint32_t>& out) const noexcept {
    phase_.within(region, out);
  }
  /// The boxes of that time, for on_way(). O(n) where anything moves.
  void move_to(double t_s) noexcept;
  /// A way longer than an answer reaches around its ends: what lies along it is no neighbour afterwards.
  [[nodiscard]] bool is_jump(const Vec3& from_mm, const Vec3& to_mm) const noexcept {
    return (to_mm - from_mm).cwiseAbs().maxCoeff() > margin_mm_;
  }
  /// Rises with every model that takes another course: an answer with another number is no longer true. Any
  /// thread. O(simulations).
  [[nodiscard]] std::uint64_t courses() const noexcept {
    std::uint64_t sum = 0;
    for (const std::shared_ptr<CourseCount>& count : courses_) sum += count->load(std::memory_order_acquire);
    return sum;
  }
  [[nodiscard]] std::size_t bytes() const noexcept;

 private:
  [[nodiscard]] geometry::Aabb box_of(const ModelBox& model) const noexcept;

  std::vector<ModelBox> models_;
  std::vector<std::shared_ptr<CourseCount>> courses_;  ///< of the models that move, each once
  double horizon_s_;
  double margin_mm_ = 0.0;  ///< how far around the HIP a list reaches
  bool moves_ = false;
  double t_s_ = 0.0;
  std::vector<geometry::Aabb> boxes_;
  geometry::BroadPhase phase_;
  NearbyModels found_;
};

}  // namespace palpate::render
