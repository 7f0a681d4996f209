// Pieces that the cases of the stress matrix are put together from.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "experiments/stress/stress_case.h"
#include "toolkit/geometry/analytic_surface.h"

namespace palpate::experiments {

/// One model, stiffness and force limit as usual. Points that are not finite are an Error.
[[nodiscard]] Result<StressSetup> setup_of_points(const std::vector<Vec3>& points, const std::string& name);
/// A generator's model with formula and mesh.
[[nodiscard]] Result<StressSetup> setup_of_generator(const std::string& generator);

/// A way of the HIP that is put together piece by piece, 1 kHz unless said otherwise.
class Way {
 public:
  explicit Way(const Vec3& start, double dt_s = 1e-3) : at_(start), dt_s_(dt_s) { stay(1, Due::kFree); }
  /// Straight on to a place in so many equal steps; the first of them come from where it was.
  Way& to(const Vec3& place, int steps, Due due);
  /// The same, with what is known of each frame.
  Way& to(const Vec3& place, int steps, const std::function<Due(const Vec3&)>& due);
  Way& stay(int frames, Due due);
  /// There at once.
  Way& jump(const Vec3& place, Due due) { return to(place, 1, due); }
  Way& tick(double dt_s) {
    dt_s_ = dt_s;
    return *this;
  }
  [[nodiscard]] const Vec3& at() const noexcept { return at_; }
  void put_into(StressSetup& setup) &&;

 private:
  Vec3 at_;
  double dt_s_, now_s_ = 0.0;
  trace::ProbePath path_;
  std::vector<Due> due_;
};

/// In and out of a surface three times, from `out_mm` outside to `deep_mm` inside along the normal, while the
/// place on it wanders; ends outside. `frames` in all.
void weave(StressSetup& setup, const geometry::AnalyticSurface& surface, double out_mm, double deep_mm,
           double clear_mm, double felt_mm, int frames);

/// Straight down at `from`, a slide at that depth, and up again; z is the free side of a floor at `floor_mm`.
/// Deeper than `felt_mm` is due to be felt, higher than `clear_mm` to be free.
struct Dip {
  Vec3 from, to;  ///< on the floor
  double out_mm = 4.0, deep_mm = 1.0, clear_mm = 3.0, felt_mm = 0.1;
  int frames = 100;  ///< of each of the three parts
};
void dip(StressSetup& setup, const Dip& dip);

/// What scaling and moving do to a setup. Points, HIP and lengths are multiplied, the stiffness is divided:
/// the forces stay. A formula is made anew by its generator at that scale; where there is an offset it is
/// left out.
struct Stretch {
  double scale = 1.0;
  Vec3 offset_mm = Vec3::Zero();  ///< of the points in the model frame, after scaling
  geometry::RigidTransform pose;  ///< of the model in the world
};
[[nodiscard]] Result<StressSetup> stretched(const std::shared_ptr<const StressSetup>& unit,
                                            const Stretch& stretch);

}  // namespace palpate::experiments
