// Building blocks of the stress cases.
#pragma once

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "experiments/stress/cell.h"

namespace palpate::experiments {

using Points = std::vector<Vec3>;
using MakeSetup = std::function<Result<StressSetup>()>;
/// Changes of a case to the model's setup: path, surface, options.
using Change = std::function<void(StressSetup&)>;

/// Adds cases of one group to the matrix.
class CaseGroup {
 public:
  CaseGroup(std::vector<StressCase>& cases, std::string name) : cases_(cases), name_(std::move(name)) {}
  void add(std::string name, std::string text, MakeSetup make, bool quick = false, bool full = false) {
    cases_.push_back({std::move(name), name_, std::move(text), quick, full, std::move(make)});
  }
  /// In the short set too.
  void quick(std::string name, std::string text, MakeSetup make) {
    add(std::move(name), std::move(text), std::move(make), true);
  }

 private:
  std::vector<StressCase>& cases_;
  std::string name_;
};

/// One model with default stiffness and force limit. Error: non-finite points.
[[nodiscard]] Result<StressSetup> setup_of_points(const std::vector<Vec3>& points, const std::string& name);
/// A generator's model with formula and mesh.
[[nodiscard]] Result<StressSetup> setup_of_generator(const std::string& generator);
/// The same, then the change.
[[nodiscard]] MakeSetup on(std::function<Points()> points, const char* name, Change change);
[[nodiscard]] MakeSetup on(const char* generator, Change change);

/// A HIP path built piece by piece, at 1 kHz.
class Way {
 public:
  explicit Way(const Vec3& start) : at_(start) { stay(1, Due::kFree); }
  /// Goes straight to a place in `steps` equal steps from the present one.
  Way& to(const Vec3& place, int steps, Due due);
  /// The same with `due` evaluated per frame.
  Way& to(const Vec3& place, int steps, const std::function<Due(const Vec3&)>& due);
  Way& stay(int frames, Due due);
  /// Goes there in one frame.
  Way& jump(const Vec3& place, Due due) { return to(place, 1, due); }
  void put_into(StressSetup& setup) &&;

 private:
  Vec3 at_;
  double now_s_ = 0.0;
  trace::ProbePath path_;
  std::vector<Due> due_;
};

/// Sets a path from `start`.
[[nodiscard]] Change along(const Vec3& start, std::function<void(Way&)> go);

/// Weaves three times through the model's formula, from `out_mm` outside to `deep_mm` inside along the
/// normal, at a wandering place; ends outside. `frames` in total.
void weave(StressSetup& setup, double out_mm, double deep_mm, double clear_mm, double felt_mm, int frames);

/// Goes straight down at `from`, slides at that depth, and goes up; z is the free side of a floor at
/// `floor_mm`. Frames deeper than `felt_mm` must be felt, those above `clear_mm` free.
struct Dip {
  Vec3 from, to;  ///< on the floor
  double out_mm = 4.0, deep_mm = 1.0, clear_mm = 3.0, felt_mm = 0.1;
  int frames = 100;  ///< each part's, of three
};
void dip(StressSetup& setup, const Dip& dip);
[[nodiscard]] Change dipping(const Dip& dip);

/// No frame must be felt any more.
void let_nothing_be_due(StressSetup& setup);

/// Scaling and moving of a setup. Multiplies points, HIP and lengths and divides the stiffness: forces stay
/// equal. The generator remakes a formula at that scale; an offset drops it.
struct Stretch {
  double scale = 1.0;
  Vec3 offset_mm = Vec3::Zero();  ///< of the points in the model frame, after scaling
  geometry::RigidTransform pose;  ///< model to world
};
[[nodiscard]] Result<StressSetup> stretched(const std::shared_ptr<const StressSetup>& unit,
                                            const Stretch& stretch);

}  // namespace palpate::experiments
