// A direction at every point, all on one side: what Poisson, ball pivoting and PCL's methods start from.
#pragma once

#include <vector>

#include "baselines/reconstruct/method_functions.h"

namespace palpate::baselines {

/// The phases that making normals is timed as.
inline constexpr const char* kNeighboursPhase = "neighbours for normals";
inline constexpr const char* kNormalsPhase = "normals";
inline constexpr const char* kOrientationPhase = "orientation of normals";
[[nodiscard]] inline bool is_of_normals(const render::PreparePhase& phase) {
  return phase.name == kNeighboursPhase || phase.name == kNormalsPhase || phase.name == kOrientationPhase;
}

/// A unit vector for every point, or zero where none could be found. Outward where the points enclose a
/// volume. Chosen by the options `normals` and `normal_neighbours`; two phases or three.
[[nodiscard]] std::vector<Vec3> oriented_normals(const MethodInput& input, render::PreparePhases& phases);

/// By CGAL: principal components or (jets) a fitted quadric over k neighbours, turned along a minimum
/// spanning tree. Its unit is one of CGAL's.
[[nodiscard]] std::vector<Vec3> cgal_normals(const MethodInput& input, bool jets, unsigned k,
                                             render::PreparePhases& phases);

/// The points with a normal, each place once, as the libraries take them: relative to the cloud's origin and
/// divided by `unit_mm`, so that their own tolerances see numbers about 1.
struct OrientedPoints {
  std::vector<Vec3> place, normal;
  std::vector<std::uint32_t> index;  ///< in the cloud
  double unit_mm = 1.0;
};
[[nodiscard]] OrientedPoints oriented_points(const MethodInput& input, double unit_mm,
                                             render::PreparePhases& phases);

}  // namespace palpate::baselines
