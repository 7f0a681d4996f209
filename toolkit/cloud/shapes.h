// The generators' surfaces, each with a grid of points and patches for other samplings. Internal to cloud.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <palpate/analytic_surface.h>
#include <palpate/cloud.h>
#include <palpate/options.h>

namespace palpate::cloud {

using Triangles = std::vector<std::array<std::uint32_t, 3>>;

/// Options of every generator; lengths already scaled.
struct CommonOptions {
  double points = 0.0;
  double spacing_mm = 0.0;  ///< 0 = from points
  double extent_mm = 0.0;
  double jitter = 0.0;
  double nonuniform = 0.0;
  std::uint64_t seed = 0;
  double scale = 1.0;
  bool mesh = true;
  std::string order;  ///< of points, if selectable
};

/// Points by index, in mm; triangles on demand.
struct Samples {
  std::size_t count = 0;
  std::function<Vec3(std::size_t)> point;
  std::function<Triangles()> triangles;
  std::optional<ScanRaster> raster;
  double spacing_mm = 0.0;
};

/// A part of a surface over [0, 1]^2. Patches of a sheet meet; different sheets may come close.
struct Patch {
  std::function<Vec3(double u, double v)> point;
  int sheet = 0;
};

struct Shape {
  std::shared_ptr<const geometry::AnalyticSurface> surface;  ///< null for an unknown kind
  Samples grid;
  std::vector<Patch> patches;    ///< together the surface
  bool is_height_field = false;  ///< z at a place is cheap, the closest place is not

  /// Unit normal at a place of the surface.
  [[nodiscard]] Vec3 normal_at(const Vec3& on_surface) const {
    return is_height_field ? surface->track({on_surface, Vec3::UnitZ()}, on_surface).normal
                           : surface->closest(on_surface).normal;
  }
};

/// From a generator's name and validated options.
[[nodiscard]] Shape shape_of(const std::string& name, const Options& options, const CommonOptions& common);

}  // namespace palpate::cloud
