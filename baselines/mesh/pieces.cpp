#include "baselines/mesh/pieces.h"

#include <algorithm>

namespace palpate::baselines {

Pieces pieces_of(const SurfaceMesh& mesh, ManyMeet many) {
  Pieces pieces;
  const std::size_t facets = mesh.facets().size();
  pieces.number.assign(facets, kNoFacet);
  pieces.turned.assign(facets, 0);
  std::vector<std::uint32_t> open;
  for (std::uint32_t start = 0; start < facets; ++start) {
    if (pieces.number[start] != kNoFacet) continue;
    const auto number = static_cast<std::uint32_t>(pieces.count++);
    pieces.number[start] = number;
    open.push_back(start);
    while (!open.empty()) {
      const std::uint32_t facet = open.back();
      open.pop_back();
      for (std::uint32_t e = 0; e < 3; ++e) {
        const HalfFacet next = mesh.neighbour(half_facet(facet, pieces.turned[facet]), e);
        if (next == kNoFacet || pieces.number[facet_of(next)] != kNoFacet) continue;
        // Of more than two facets at an edge each side has its own neighbour.
        if (many == ManyMeet::kEnds &&
            facet_of(mesh.neighbour(half_facet(facet, 1 - pieces.turned[facet]), e)) != facet_of(next))
          continue;
        pieces.number[facet_of(next)] = number;
        pieces.turned[facet_of(next)] = static_cast<std::uint8_t>(side_of(next));
        open.push_back(facet_of(next));
      }
    }
  }
  if (pieces.count <= 1) pieces.number = {};
  if (std::find(pieces.turned.begin(), pieces.turned.end(), 1) == pieces.turned.end()) pieces.turned = {};
  return pieces;
}

std::vector<std::uint32_t> components_of(const SurfaceMesh& mesh) {
  std::vector<std::uint32_t> number(mesh.facets().size(), kNoFacet);
  std::vector<std::uint32_t> open;
  std::uint32_t count = 0;
  for (std::uint32_t start = 0; start < number.size(); ++start) {
    if (number[start] != kNoFacet) continue;
    number[start] = count;
    open.push_back(start);
    while (!open.empty()) {
      const std::uint32_t facet = open.back();
      open.pop_back();
      for (std::uint32_t e = 0; e < 3; ++e)
        for (const std::uint32_t side : {0u, 1u}) {
          const HalfFacet next = mesh.neighbour(half_facet(facet, side), e);
          if (next == kNoFacet || number[facet_of(next)] != kNoFacet) continue;
          number[facet_of(next)] = count;
          open.push_back(facet_of(next));
        }
    }
    ++count;
  }
  return number;
}

}  // namespace palpate::baselines
