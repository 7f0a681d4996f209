// Covers the points by quadrics, each as large as the points allow: a fit's radius grows while it agrees, at
// its centre, with every smaller one within a number of standard errors (Lepski's rule). So noise is averaged
// over as much of the surface as has no shape of its own, and small features of clean points stay.
#pragma once

#include <vector>

#include "toolkit/smooth/noise_field.h"
#include "toolkit/smooth/quadric.h"
#include "toolkit/smooth/surround.h"

namespace palpate::render {

struct Patch {
  Quadric quadric;
  double support = 0.0;      ///< mm from quadric.at, along the tangent plane: its weight ends there
  double spacing = 0.0;      ///< of its points, mm
  double sigma = 0.0;        ///< of its points about it, mm
  double noise = 0.0;        ///< of points around it, mm: sigma is no less for certain
  double slope_error = 0.0;  ///< a standard error of its normal
  int points = 0;            ///< that it follows
  double trust = 1.0;        ///< weight beside others: by how well it is known, at most 1
  bool sure = false;         ///< no piece of noise or stray points
  double reached = 0.0;      ///< mm along the tangent plane: where its points end
  Filled filled;             ///< by its points, over quadric.u and v in shares of `reached`
};

struct CoverRule {
  double detail = 2.0;  ///< standard errors before a deviation is shape
  const NoiseField& noise;
};

struct Cover {
  std::vector<Patch> patches;
  std::size_t left_out = 0;  ///< points that stand alone
};

/// A patch's weight at a share of its support's square: (1 - x)^3, which has two continuous derivatives at
/// its end.
[[nodiscard]] inline double patch_weight(double share_sq) noexcept {
  if (!(share_sq < 1.0)) return 0.0;
  const double rest = 1.0 - share_sq;
  return rest * rest * rest;
}

/// The same for any number of threads. O(points).
[[nodiscard]] Cover cover_points(const SmoothPoints& points, const CoverRule& rule, int threads);

}  // namespace palpate::render
