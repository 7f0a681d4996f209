// Generated models: exact surfaces known by formula, sampled at any density, so that everything runs offline
// and every answer can be checked. Deterministic: one spec gives the same points on every run and with any
// number of threads.
#pragma once

#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "toolkit/cloud/cloud.h"
#include "toolkit/core/options.h"
#include "toolkit/core/result.h"
#include "toolkit/geometry/analytic_surface.h"
#include "toolkit/geometry/triangle_mesh.h"

namespace palpate::cloud {

/// A model made by a generator. Everything in the model frame, mm.
struct GeneratedModel {
  Cloud cloud;  ///< on the surface, up to the store's float rounding
  /// The regular triangulation of the samples, counter-clockwise from outside; vertex i is point i, in double
  /// and on the surface. Null with mesh=false, with a jitter of 0.25 or more, where triangles could turn
  /// over, and where points are off the grid: another sampling, noise, outliers.
  std::shared_ptr<geometry::TriangleMesh> original_mesh;
  std::shared_ptr<const geometry::AnalyticSurface> surface;  ///< never null
  std::string spec;  ///< the generator with every option, "sinusoid:amplitude_mm=10:..."
  double nominal_spacing_mm =
      0.0;  ///< grid step before jitter and warping, else the root of area over points
};

struct Generator {
  std::string name;
  std::string summary;  ///< one line with the formula and the order of points
  std::vector<OptionSpec> options;
};

/// All generators, in the order for --help: sinusoid, plane, saddle, relief, wedge, sphere, pebble, torus,
/// slab, ellipsoid, rounded-box, bowl, shells.
[[nodiscard]] const std::vector<Generator>& generators();
[[nodiscard]] const Generator* find_generator(std::string_view name);

/// `given` completed by the generator's defaults; an Error where an option would do nothing.
[[nodiscard]] Result<Options> complete_options(const Generator& generator, const Options& given);

/// Makes the model. Unknown names and options, too many points (over a hundred million) and shapes that
/// cannot be are Errors. O(points), on all threads: about a second for ten million points with their mesh.
///
/// Options of all: `points` or `spacing_mm` (never both), `extent_mm`, `jitter` (largest shift along the
/// surface, as a fraction of the spacing), `nonuniform` (a: spacing varies from 1 - a to 1 + a times the
/// nominal), `seed`, `scale` (multiplies every length), `mesh`. Height fields cover the square [-extent/2,
/// extent/2]^2 in scanner order: rows of increasing y, in a row increasing x (with `order=boustrophedon`
/// every second row decreasing x), and have `cloud.raster` set. The torus has it set with `order=turntable`:
/// its rings are the rows, and rows and columns wrap around. An order changes where points stand in the
/// store, not where they stand in space. `sampling` takes the points in another way than the grid, `noise`
/// and `outliers` move them off the surface, in spacings (sampling.h says how), `shuffle` takes their order.
/// The number of points is the nearest the grid can give: a square number for height fields.
[[nodiscard]] Result<GeneratedModel> generate(const NamedOptions& spec);

}  // namespace palpate::cloud
