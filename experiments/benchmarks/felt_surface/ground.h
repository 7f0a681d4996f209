// A prepared set: points, path, and truth.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include <palpate/accuracy.h>
#include <palpate/progress.h>
#include <palpate/renderer.h>
#include <palpate/result.h>
#include <palpate/trace.h>

namespace palpate::felt {

// Point sets of felt_surface, outside the suite.

/// The probe's motion on a set.
enum class Stroke {
  kWeave,   ///< everywhere, in and out
  kMouth,   ///< presses a sphere's wall, slides into its mouth and to the centre
  kRidge,   ///< slides beside a ridge down one face and crosses it near its tip; a deeper crossing would
            ///< catch the HIP behind a face for a time decided by tiny differences
  kBorder,  ///< passes beside a sheet's border, below its plane
  kCorner,  ///< presses into the corner of two sheets without common points, slides along, and leaves
};

struct DataSet {
  std::string name;
  std::string about;  ///< description
  /// A generator with options; for scans the file under PALPATE_DATA; for two sheets the wall's extent below
  /// the floor in shares of its half.
  std::string generate;
  std::string quick;  ///< the same with fewer points
  Stroke stroke = Stroke::kWeave;
  bool is_scan = false;  ///< points off the vertices of a scan's mesh, which is the truth
  double noise = 0.0;    ///< scans, in spacings
  /// For scans: file of the mesh's raw points under PALPATE_DATA, in its frame; used instead of points off
  /// the mesh.
  std::string raw;
  std::uint64_t seed = 0;  ///< of points and path; 0: the defaults, else unexamined others
};

[[nodiscard]] const std::vector<DataSet>& data_sets();
[[nodiscard]] const DataSet* find_set(std::string_view name);
/// A named set, or a generator's text ("torus:points=5000") with a weave; with a seed, other random points
/// and paths. Error: neither.
[[nodiscard]] Result<DataSet> choose_set(const std::string& name, std::uint64_t seed);

inline constexpr double kStiffness = 0.5;  ///< N/mm
inline constexpr double kStepS = 1e-3;     ///< 1 kHz
inline constexpr double kSpeedMmS = 40.0;
inline constexpr double kDepthMm = 1.8;
inline constexpr double kClearanceMm = 0.4;

struct Ground {
  render::SceneInput scene;                                  ///< one model: points without mesh or formula
  std::shared_ptr<const geometry::AnalyticSurface> surface;  ///< the formula, or null
  std::shared_ptr<const geometry::TriangleMesh> mesh;        ///< a scan's truth
  double spacing_mm = 0.0;
  trace::ProbePath path;
  trace::ReferenceTrace reference;
  std::unique_ptr<metrics::TruthSurface> truth;
  /// By frame: true contact where another part of the surface is nearer to the HIP than its god object, so it
  /// is held from behind. Tiny differences decide where it is caught.
  std::vector<std::uint8_t> caught;
  [[nodiscard]] const cloud::Cloud& points() const { return *scene.models.front().cloud; }
};

/// Error with gave_up: the data are absent and the set is skipped.
[[nodiscard]] Result<Ground> make_ground(const DataSet& set, bool quick, std::size_t frames,
                                         Progress& progress);

/// Closed loops of the probe, each from and to the same free place. Empty for scans and strokes.
[[nodiscard]] std::vector<trace::ProbePath> closed_loops(const Ground& ground, std::size_t count);

}  // namespace palpate::felt
