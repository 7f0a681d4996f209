// Known reasons for failed cells, inherent in a method.
#include <array>
#include <string_view>

#include "experiments/stress/matrix.h"

namespace palpate::experiments {
namespace {

struct Reason {
  std::string_view renderer, check, name;  ///< case or group; empty: any
  std::string_view text;
};

constexpr std::string_view kSinglePrecision =
    "Embree reads coordinates in single precision, here as the file has them: far from its origin they lose "
    "the "
    "mesh. frame=local, which is usual, keeps it";

constexpr std::string_view kBetweenCoarse =
    "Its size follows the gap that one in a hundred exceed: where a few points stand a hundred times as far "
    "apart as "
    "the rest it falls between them";
constexpr std::string_view kGraphWalk =
    "It walks from vertex to nearer vertex, and facets around the last one alone count: on thin and pointed "
    "bodies, "
    "and from afar, these are of another sheet";

constexpr std::array kReasons = {
    Reason{"penalty-grid", "free", "",
           "Its force begins at a threshold of distance in front of the points, by design"},
    Reason{"penalty-grid", "felt", "",
           "Its force ends at its threshold behind the points: it remembers no way in"},
    Reason{"mls-penalty", "free", "",
           "It knows no way in: where the fitted surface goes on beyond an open border, or turns its side, "
           "there is force"},
    Reason{"mls-penalty", "felt", "", "It knows no way in: out of reach of the points there is no force"},
    Reason{"vector-field", "felt", "",
           "Deeper than its band of voxels, and near sharp edges, there is no force: it knows no way in"},
    Reason{"vector-field", "free", "", "Its sides are those of a closed surface seen from outside"},
    Reason{"mls-proxy", "felt", "",
           "Its proxy moves by a bounded number of ticks a frame and tunnels where a HIP is fast or deep"},
    Reason{"mls-proxy", "free", "",
           "Past an open border, or inside a hollow body, its field still has a side"},
    Reason{
        "cloud-literal", "free", "",
        "Figure 42 as printed: the contact state has no side and sticks; boxes are of the worst resolution"},
    Reason{"cloud-literal", "twin", "",
           "Its 0.2 mm rule of shading (section 3.4) is a length that does not scale"},
    Reason{"cloud-literal", "felt", "", "Figure 42 as printed: contact is told by crossings of boxes alone"},
    Reason{"heightfield-literal", "twin", "", "Its 0.2 mm rule of shading is a length that does not scale"},
    Reason{"sphere-proxy", "felt", "", kBetweenCoarse},
    Reason{"stream-proxy", "felt", "", kBetweenCoarse},
    Reason{"variable-proxy", "felt", "", kBetweenCoarse},
    Reason{"sdf-godobject", "felt", "", kBetweenCoarse},
    Reason{"sdf-godobject", "free", "",
           "The sign of its field is that of the nearest points' planes: past an open border, at a tip and "
           "inside a "
           "hollow body it is not the side that the HIP came from"},
    Reason{"vgraph", "free", "", kGraphWalk},
    Reason{"vgraph", "felt", "", kGraphWalk},
    Reason{"mesh-proxy", "twin", "",
           "Which of several facets stops its sphere hangs on rounding in that frame"},
    Reason{"analytic", "bounded", "probe",
           "The truth looks for its way in by steps that are safe, up to the number that its bound states: "
           "from so "
           "far off it takes them all"},
    Reason{"mesh-godobject:frame=world", "twin", "offset", kSinglePrecision},
    Reason{"mesh-godobject:frame=world", "felt", "offset", kSinglePrecision},
    Reason{"mesh-godobject:frame=world", "free", "offset", kSinglePrecision},
};

bool matches(std::string_view pattern, std::string_view value) noexcept {
  return pattern.empty() || pattern == value;
}

}  // namespace

std::string known_reason(const RendererRequest& request, const StressCase& one, const StressCell& cell) {
  if (cell.status != CellStatus::kFailed) return {};
  const std::string text = spelled(request);
  for (const Reason& reason : kReasons)
    if ((reason.renderer == request.name || reason.renderer == text) && reason.check == cell.check &&
        (matches(reason.name, one.name) || matches(reason.name, one.group)))
      return std::string(reason.text) + ".";
  return {};
}

}  // namespace palpate::experiments
