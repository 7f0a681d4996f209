// Goals of the simulated hand in a live session. The scene may be any.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include <palpate/device/device.h>
#include <palpate/device/servo.h>
#include <palpate/renderer.h>
#include "device/simulated/hand_script.h"
#include "toolkit/paths/hand.h"

namespace palpate::experiments {

/// A window's hand, guided by the mouse. Not in live_hands(): it needs a person.
inline constexpr const char* kMouseHand = "mouse";

/// Reacts to the force: ExploringHand.
inline constexpr const char* kExploreHand = "explore";
/// Path generator of that hand, and a test for it.
inline constexpr const char* kHandPath = "hand";
[[nodiscard]] bool is_hand_path(const std::string& path);
/// Follows the path's positions and ignores the force.
inline constexpr const char* kFollowHand = "follow";

/// "explore", "follow", "press", "slide", "tap".
[[nodiscard]] const std::vector<std::string>& live_hands();

/// A script of `seconds`, device frame; not for "explore". "follow" goes along the path and back; the others
/// repeat their task at a place that `renderer` touches along the path. Error: no such place.
[[nodiscard]] Result<device::HandScript> live_hand(const std::string& hand, const trace::ProbePath& path,
                                                   render::HapticRenderer& renderer,
                                                   const device::DeviceMap& map, double seconds);

/// The renderer's deepest contact along the path; device frame. Error: none.
[[nodiscard]] Result<device::TaskPlace> touched_place(const trace::ProbePath& path,
                                                      render::HapticRenderer& renderer,
                                                      const device::DeviceMap& map);

/// The points, in the world frame, that the device reaches with room to lift off. Error: too few to go by.
[[nodiscard]] Result<cloud::Cloud> within_reach(const cloud::Cloud& cloud, const device::DeviceMap& map,
                                                const device::DeviceLimits& limits);

/// The hand of `--path hand` at a simulated device: feels the force sent and holds the handle by a spring.
/// Observes every tick with fixed memory.
class ExploringHand final : public device::TickObserver {
 public:
  /// Refers to the target's cloud and faces. `grip_n_per_mm`: the hand's spring per mm of the device.
  [[nodiscard]] static Result<std::unique_ptr<ExploringHand>> create(const paths::PathTarget& target,
                                                                     const paths::HandOptions& options,
                                                                     const device::DeviceMap& map,
                                                                     double grip_n_per_mm, double period_s);
  /// Free starting point, world frame.
  [[nodiscard]] const Vec3& start_mm() const noexcept { return begin_mm_; }
  /// The script for the device.
  [[nodiscard]] device::HandScript script() const { return device::HandScript::guided(kExploreHand, guide_); }
  void took(const device::Tick& tick) noexcept override;

 private:
  ExploringHand(paths::Hand hand, const paths::PathTarget& target, const device::DeviceMap& map,
                double grip_n_per_mm, double period_s);
  paths::Hand hand_;
  geometry::RigidTransform world_from_model_;
  Vec3 origin_mm_;
  device::DeviceMap map_;
  double grip_n_per_mm_, period_s_;
  Vec3 begin_mm_, goal_mm_;  // world frame
  double t_s_ = 0.0;
  std::shared_ptr<device::HandGuide> guide_;
};

}  // namespace palpate::experiments
