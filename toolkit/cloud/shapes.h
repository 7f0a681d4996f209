// What the generators sample: a surface with the grid of its points, and with patches for the other ways of
// sampling. Internal to cloud.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "toolkit/cloud/cloud.h"
#include "toolkit/core/options.h"
#include "toolkit/geometry/analytic_surface.h"

namespace palpate::cloud {

using Triangles = std::vector<std::array<std::uint32_t, 3>>;

/// What every generator takes, lengths already scaled.
struct Common {
  double points = 0.0;
  double spacing_mm = 0.0;  ///< 0 = from points
  double extent_mm = 0.0;
  double jitter = 0.0;
  double nonuniform = 0.0;
  std::uint64_t seed = 0;
  double scale = 1.0;
  bool mesh = true;
  std::string order;  ///< of points, where there is a choice
};

/// Points by index, in mm; triangles as an afterthought.
struct Samples {
  std::size_t count = 0;
  std::function<Vec3(std::size_t)> point;
  std::function<Triangles()> triangles;
  std::optional<ScanRaster> raster;
  double spacing_mm = 0.0;
};

/// A part of a surface over the square [0, 1]^2. Patches of one sheet meet; different sheets may come close.
struct Patch {
  std::function<Vec3(double u, double v)> point;
  int sheet = 0;
};

struct Shape {
  std::shared_ptr<const geometry::AnalyticSurface> surface;  ///< null where there is none of this kind
  Samples grid;
  std::vector<Patch> patches;    ///< which together are the surface
  bool is_height_field = false;  ///< its closest place is costly, its own place is not

  /// Unit normal at a place of the surface.
  [[nodiscard]] Vec3 normal_at(const Vec3& on_surface) const {
    return is_height_field ? surface->track({on_surface, Vec3::UnitZ()}, on_surface).normal
                           : surface->closest(on_surface).normal;
  }
};

/// Of a generator's name and its validated options.
[[nodiscard]] Shape shape_of(const std::string& name, const Options& options, const Common& common);

}  // namespace palpate::cloud
