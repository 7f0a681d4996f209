// What the simulated hand of a live session means to do, over any scene.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "device/servo/device_map.h"
#include "device/servo/tick_observer.h"
#include "device/simulated/hand_guide.h"
#include "toolkit/render/renderer.h"
#include "toolkit/trace/hand.h"

namespace palpate::experiments {

/// Of a window: the hand goes where the mouse says. Not among live_hands(): it needs somebody there.
inline constexpr const char* kMouseHand = "mouse";

/// Goes by what is felt: ExploringHand.
inline constexpr const char* kExploreHand = "explore";
/// Path generator of that hand, and whether a path is one.
inline constexpr const char* kHandPath = "hand";
[[nodiscard]] bool is_hand_path(const std::string& path);
/// Goes after the places of the path, whatever is felt there.
inline constexpr const char* kFollowHand = "follow";

/// "explore", "follow", "press", "slide", "tap".
[[nodiscard]] const std::vector<std::string>& live_hands();

/// A script of `seconds`, device frame; not of "explore". "follow" goes along the path and back for as long
/// as that takes; the others do their task again and again at a place that `renderer` touches along the path.
/// Errors: there is none.
[[nodiscard]] Result<device::HandScript> live_hand(const std::string& hand, const trace::ProbePath& path,
                                                   render::HapticRenderer& renderer,
                                                   const device::DeviceMap& map, double seconds);

/// The deepest contact along the path, as the renderer feels it; device frame. Errors: there is none.
[[nodiscard]] Result<device::TaskPlace> touched_place(const trace::ProbePath& path,
                                                      render::HapticRenderer& renderer,
                                                      const device::DeviceMap& map);

/// The hand of `--path hand` around a simulated device: it feels the force that the device got, and holds the
/// handle by a spring. An observer of every tick, of fixed memory.
class ExploringHand final : public device::TickObserver {
 public:
  /// Refers to the target's cloud and faces. `grip_n_per_mm`: the hand's spring, in mm of the device.
  [[nodiscard]] static Result<std::unique_ptr<ExploringHand>> create(const trace::PathTarget& target,
                                                                     const trace::HandOptions& options,
                                                                     const device::DeviceMap& map,
                                                                     double grip_n_per_mm, double period_s);
  /// Where it begins, world: free.
  [[nodiscard]] const Vec3& begin_mm() const noexcept { return begin_mm_; }
  /// What the device is to follow.
  [[nodiscard]] device::HandScript script() const { return device::HandScript::guided(kExploreHand, guide_); }
  void took(const device::Tick& tick) noexcept override;

 private:
  ExploringHand(trace::Hand hand, const trace::PathTarget& target, const device::DeviceMap& map,
                double grip_n_per_mm, double period_s);
  trace::Hand hand_;
  geometry::RigidTransform world_from_model_;
  Vec3 origin_mm_;
  device::DeviceMap map_;
  double grip_n_per_mm_, period_s_;
  Vec3 begin_mm_, goal_mm_;  // world
  double t_s_ = 0.0;
  std::shared_ptr<device::HandGuide> guide_;
};

}  // namespace palpate::experiments
