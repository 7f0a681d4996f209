// A hand in front of a depth camera: presses, slides and lifts on whatever comes, and gives way to it.
#pragma once

#include <functional>
#include <string>

#include <palpate/depth_stream.h>
#include <palpate/options.h>
#include <palpate/renderer.h>
#include <palpate/result.h>
#include <palpate/trace.h>

namespace palpate::experiments {

inline constexpr const char* kPressAndSlide = "press-and-slide";

/// The view that the hand works in.
struct HandView {
  geometry::RigidTransform world_from_camera;
  double nearest_mm = 0.0, median_mm = 0.0, farthest_mm = 0.0;  ///< depths of the middle of the image
  double half_width_mm = 0.0, half_height_mm = 0.0;             ///< of the view at the median depth
};
/// Of the first image. An Error where its middle is empty.
[[nodiscard]] Result<HandView> view_of(const stream::DepthFrame& frame, const stream::DepthCamera& camera);

/// "press-and-slide[:frames=N:fastest=SHARE]", completed. Errors: unknown or invalid options.
[[nodiscard]] Result<NamedOptions> parse_press_and_slide(const std::string& text);

/// Appends HIP positions at 1 kHz to `path`, one after the other, as `felt` answers to each: the force at a
/// HIP and a time, which rises from 0. It begins in front of everything in the middle of the image.
/// The hand yields like a damper, v = (its force + the felt one) / b, and slides along a Lissajous curve over
/// the middle half of the view, at most `fastest` median depths a second (0.5 m/s at 1 m).
using FeltForce = std::function<Vec3(const Vec3& hip_mm, double t_s)>;
void press_and_slide(const HandView& view, double stiffness_n_per_mm, const NamedOptions& options,
                     const FeltForce& felt, trace::ProbePath& path);

}  // namespace palpate::experiments
