// Oriented normals for Poisson, ball pivoting and PCL's methods.
#pragma once

#include <vector>

#include "baselines/reconstruct/method_functions.h"

namespace palpate::baselines {

/// Timed phases of making normals.
inline constexpr const char* kNeighboursPhase = "neighbours for normals";
inline constexpr const char* kNormalsPhase = "normals";
inline constexpr const char* kOrientationPhase = "orientation of normals";
[[nodiscard]] inline bool is_of_normals(const render::PreparePhase& phase) {
  return phase.name == kNeighboursPhase || phase.name == kNormalsPhase || phase.name == kOrientationPhase;
}

/// A unit vector per point, or zero if none was found; outward if the points enclose a volume. Options
/// `normals` and `normal_neighbours`; two or three phases.
[[nodiscard]] std::vector<Vec3> oriented_normals(const MethodInput& input, render::PreparePhases& phases);

/// By CGAL: principal components or (jets) a fitted quadric over k neighbours, oriented along a minimum
/// spanning tree.
[[nodiscard]] std::vector<Vec3> cgal_normals(const MethodInput& input, bool jets, unsigned k,
                                             render::PreparePhases& phases);

/// The points with a normal, each place once, relative to the cloud's origin and divided by `unit_mm`: near
/// 1, to suit the libraries' tolerances.
struct OrientedPoints {
  std::vector<Vec3> place, normal;
  std::vector<std::uint32_t> index;  ///< in the cloud
  double unit_mm = 1.0;
};
[[nodiscard]] OrientedPoints oriented_points(const MethodInput& input, double unit_mm,
                                             render::PreparePhases& phases);

}  // namespace palpate::baselines
