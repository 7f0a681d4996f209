// One model of `cloud-literal`: figures 36 and 42 and section 3.5 to the letter, with their defects.
#pragma once

#include <cstdint>

#include "toolkit/geometry/segment_box.h"
#include "toolkit/points/point_model.h"
#include "toolkit/points/point_walk.h"
#include "toolkit/render/shading.h"
#include "toolkit/render/surface_response.h"

namespace palpate::render {

/// The cells that a segment searches.
enum class CellRule : std::uint8_t {
  kSampled,   ///< as printed (section 3.1.3): cells at the starts of sub-segments
  kCrossed,   ///< every cell the segment crosses
  kAdjacent,  ///< also those whose boxes can reach into it (first remedy of 3.1.4)
};

struct LiteralOptions {
  CellRule cells = CellRule::kSampled;
  bool text_form = false;  ///< uses the exit test of section 3.2.4's text, not the figure's
};

/// Belongs to one thread. Work per update as printed: cells crossed times points per cell, unbounded; walks
/// of at most kMaxWalkSteps moves.
class LiteralModel {
 public:
  LiteralModel(points::PointInstance body, Shading shading, const LiteralOptions& options) noexcept
      : body_(std::move(body)), model_(*body_.points), shading_(shading), options_(options) {}

  // A local model of the frame loop. The thesis does not say how several contacts combine.
  struct Memory {};
  static constexpr bool kForcesAddUp = true;
  [[nodiscard]] ModelPose& pose() noexcept { return body_.pose; }
  [[nodiscard]] const ModelPose& pose() const noexcept { return body_.pose; }
  void release_contact(const Vec3& h) noexcept;
  void release() noexcept {}  // friction rolls the god object back and keeps no other state
  [[nodiscard]] bool touch(const Vec3& goal, const Vec3& h, Memory& memory, SurfaceContact& contact,
                           FrameStatus& status, FrameCounters& counters) noexcept;
  [[nodiscard]] SurfaceResponse respond(const SurfaceContact& /*contact*/) const noexcept { return answer_; }

 private:
  void answer(const Vec3& h, std::uint32_t from, FrameStatus& status, FrameCounters& counters) noexcept;
  [[nodiscard]] double sphere_radius(std::uint32_t place) const noexcept;
  template <class Test>
  bool any_in_cells(const Vec3& a, const Vec3& b, FrameCounters& counters, Test&& test) const noexcept;
  template <class Test>
  bool any_sampled(const Vec3& a, const Vec3& b, Test&& test) const noexcept;
  bool clip(const Vec3& a, const Vec3& d, double& t0, double& t1) const noexcept;
  [[nodiscard]] bool resting(const Vec3& a, const Vec3& b) const noexcept;
  [[nodiscard]] bool touches(const geometry::SegmentProbe& probe, std::uint32_t place,
                             FrameCounters& counters) const noexcept;
  [[nodiscard]] bool crosses(const Vec3& a, Vec3 b, FrameCounters& counters) const noexcept;
  [[nodiscard]] std::uint32_t nearest_crossed(const Vec3& h, const Vec3& before,
                                              FrameCounters& counters) const noexcept;

  points::PointInstance body_;
  const points::PointModel& model_;
  Shading shading_;
  LiteralOptions options_;
  Vec3 previous_ = Vec3::Zero();
  Vec3 last_direction_ = Vec3::UnitZ();
  std::uint32_t god_ = 0;  ///< of the last contact frame, after friction
  bool collided_ = false;
  SurfaceResponse answer_;  ///< of the last touch
};

}  // namespace palpate::render
