// The points that felt_surface tries renderers on, none of them the suite's.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "toolkit/core/result.h"

namespace palpate::felt {

/// What the probe does on a set.
enum class Stroke {
  kWeave,   ///< all over, in and out
  kMouth,   ///< presses the wall of a ball, slides into its mouth, goes to the middle
  kRidge,   ///< pressed beside a ridge and slid along and down one face, and across it near its tip; deeper
            ///< across, a HIP is caught behind a face, and a hair's breadth decides for how long
  kBorder,  ///< passes beside the border of a sheet, below its plane
  kCorner,  ///< is pressed into the corner of two sheets that share no point, slides along it, and leaves
};

struct DataSet {
  std::string name;
  std::string about;  ///< for a person
  /// A generator with its options; of scans the file under PALPATE_DATA; of two sheets how far, in shares of
  /// the floor's half, the wall goes on below it.
  std::string generate;
  std::string quick;  ///< the same with fewer points
  Stroke stroke = Stroke::kWeave;
  bool is_scan = false;  ///< points off the vertices of a scan's own mesh, which is the truth
  double noise = 0.0;    ///< of scans, in spacings
  /// Of scans: the file of the raw points under PALPATE_DATA that the mesh was made of, in its frame; they
  /// are felt instead of points off the mesh.
  std::string raw;
  std::uint64_t seed = 0;  ///< of points and path: 0, the usual ones; else others that nobody looked at
};

[[nodiscard]] const std::vector<DataSet>& data_sets();
[[nodiscard]] const DataSet* find_set(std::string_view name);
/// A set by its name, or one of a generator's text ("torus:points=5000"), which is woven over. With a seed,
/// other points and paths by chance. Errors: neither.
[[nodiscard]] Result<DataSet> choose_set(const std::string& name, std::uint64_t seed);

}  // namespace palpate::felt
