// Generated models: exact surfaces known by formula, sampled at any density. They need no files and every
// answer can be checked. Deterministic: one spec gives the same points for any number of threads.
//
// First:
//   const auto spec = palpate::parse_named_options("sinusoid:points=10201");
//   auto model = palpate::cloud::generate(*spec);
//   if (!model) return failed(model.error());
//   scene.models[0].analytic = model->surface;
//   scene.models[0].cloud = std::make_shared<const palpate::cloud::Cloud>(std::move(model->cloud));
#pragma once

#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include <palpate/analytic_surface.h>
#include <palpate/cloud.h>
#include <palpate/geometry.h>
#include <palpate/options.h>
#include <palpate/result.h>

namespace palpate::cloud {

/// A generated model, in the model frame, mm.
struct GeneratedModel {
  Cloud cloud;  ///< on the surface up to float rounding
  /// The regular triangulation of the samples, counter-clockwise from outside; vertex i is point i in double
  /// precision, on the surface. Null with mesh=false, with jitter >= 0.25 (triangles could turn over), and
  /// for points off the grid (other sampling, noise, outliers).
  std::shared_ptr<geometry::TriangleMesh> original_mesh;
  std::shared_ptr<const geometry::AnalyticSurface> surface;  ///< never null
  std::string spec;                 ///< the generator with every option, "sinusoid:amplitude_mm=10:..."
  double nominal_spacing_mm = 0.0;  ///< grid step before jitter and warping, else sqrt(area / points)
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

/// `given` completed by the generator's defaults. An option without effect is an Error.
[[nodiscard]] Result<Options> complete_options(const Generator& generator, const Options& given);

/// Makes the model. Unknown names and options, over a hundred million points and impossible shapes are
/// Errors. O(points), parallel: about a second for ten million points with their mesh.
///
/// Options of every generator:
/// `points` or `spacing_mm` (never both); `extent_mm`; `seed`; `mesh`; `scale` multiplies every length;
/// `jitter` is the largest shift along the surface in spacings; `nonuniform` = a varies the spacing from 1 -
/// a to 1 + a times the nominal;
/// `sampling` replaces the grid; `noise` and `outliers` move points off the surface, in spacings
/// (sampling.h); `shuffle` permutes their order.
/// The number of points is the nearest that the grid allows: a square for height fields.
/// Height fields cover [-extent/2, extent/2]^2 in scanner order: rows of increasing y, x increasing in each
/// row (alternating with `order=boustrophedon`), and set `cloud.raster`. The torus sets it with
/// `order=turntable`: its rings are the rows, and rows and columns wrap around. An order changes indices, not
/// positions.
[[nodiscard]] Result<GeneratedModel> generate(const NamedOptions& spec);

}  // namespace palpate::cloud
