// Point sets of felt_surface, outside the suite.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include <palpate/result.h>

namespace palpate::felt {

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

}  // namespace palpate::felt
