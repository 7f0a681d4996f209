// Building blocks of the behaviours.
#pragma once

#include <string>
#include <vector>

#include "experiments/behaviours/behaviour.h"

namespace palpate::experiments {

/// Stiffness of every model in the suite.
inline constexpr double kBehaviourStiffness = 0.5;
/// Speed of a hand.
inline constexpr double kHandSpeed = 50.0;

/// A generator's model as a scene.
[[nodiscard]] Result<BehaviourScene> generated_scene(const std::string& generator);
/// The same surface with other points.
[[nodiscard]] Result<BehaviourScene> scene_of_points(
    const std::vector<Vec3>& points, std::string name,
    std::shared_ptr<const geometry::AnalyticSurface> surface);

/// A 1 kHz path along straight lines between corners, with its truth. The first corner must be free.
[[nodiscard]] Result<Stroke> stroke(const std::vector<BehaviourScene>& scenes, std::size_t scene,
                                    const std::vector<Vec3>& corners, double speed_mm_s = kHandSpeed);
/// A given path with its truth.
[[nodiscard]] Result<Stroke> stroke_along(const std::vector<BehaviourScene>& scenes, std::size_t scene,
                                          trace::ProbePath path);

/// Aperiodic places in [low, high] from multiples of the golden section, so none repeats a pattern of the
/// points.
[[nodiscard]] double scattered(std::size_t i, double low, double high) noexcept;

/// True if the force differs from the truth by more than a hand distinguishes and a device resolves.
[[nodiscard]] bool out_of_band(const render::Frame& frame, const trace::TruthFrame& truth) noexcept;
/// True if force and true force enclose more than `deg`, or a due force is missing.
[[nodiscard]] bool turned_by(const render::Frame& frame, const trace::TruthFrame& truth, double deg) noexcept;

/// Number of true contact frames.
[[nodiscard]] std::uint64_t contact_frames(const Stroke& stroke) noexcept;

}  // namespace palpate::experiments
