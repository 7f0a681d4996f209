// Pieces that the behaviours are put together from.
#pragma once

#include <string>
#include <vector>

#include "experiments/behaviours/behaviour.h"

namespace palpate::experiments {

/// Of every model of the suite.
inline constexpr double kBehaviourStiffness = 0.5;
/// A hand's pace.
inline constexpr double kHandSpeed = 50.0;

/// The model of a generator as a scene of its own.
[[nodiscard]] Result<BehaviourScene> generated_scene(const std::string& generator);
/// The same surface under other points.
[[nodiscard]] Result<BehaviourScene> scene_of_points(
    const std::vector<Vec3>& points, std::string name,
    std::shared_ptr<const geometry::AnalyticSurface> surface);

/// Straight ways from corner to corner at 1 kHz, with the truth along them. The first corner must be free.
[[nodiscard]] Result<Stroke> stroke(const std::vector<BehaviourScene>& scenes, std::size_t scene,
                                    const std::vector<Vec3>& corners, double speed_mm_s = kHandSpeed);
/// A path that exists, with the truth along it.
[[nodiscard]] Result<Stroke> stroke_along(const std::vector<BehaviourScene>& scenes, std::size_t scene,
                                          trace::ProbePath path);

/// Places on a line in [low, high] that never repeat a pattern of the points: multiples of the golden
/// section.
[[nodiscard]] double scattered(std::size_t i, double low, double high) noexcept;

/// The force differs from the truth by more than a hand can tell apart, and more than a device can show.
[[nodiscard]] bool out_of_band(const render::Frame& frame, const trace::TruthFrame& truth) noexcept;
/// Angle between the force and the truth's is above `deg`; no force where there should be one counts too.
[[nodiscard]] bool turned_by(const render::Frame& frame, const trace::TruthFrame& truth, double deg) noexcept;

/// Frames of true contact.
[[nodiscard]] std::uint64_t contact_frames(const Stroke& stroke) noexcept;

}  // namespace palpate::experiments
