#include "baselines/mesh/pieces.h"

#include <algorithm>

#include "toolkit/core/parallel.h"

namespace palpate::baselines {

namespace {

/// Facets a chunk: along a curve few of them have neighbours in others. Where a piece cannot agree it decides
/// where that shows, so it depends on nothing.
constexpr std::size_t kFacetsPerChunk = 16384;

/// What lies over edge `e` of a facet alone, seen from the facet's side 0; kNoFacet where others do too, or
/// nothing does.
HalfFacet only_neighbour(const SurfaceMesh& mesh, std::uint32_t facet, std::uint32_t e) noexcept {
  const HalfFacet next = mesh.neighbour(half_facet(facet, 0), e);
  if (next == kNoFacet || facet_of(next) == facet) return kNoFacet;
  return facet_of(mesh.neighbour(half_facet(facet, 1), e)) == facet_of(next) ? next : kNoFacet;
}

/// Two facets that belong together across a border of chunks, and whether they look to opposite sides.
struct Link {
  std::uint32_t facet, other, turned;
};

/// The first facet of what `facet` has been joined to, and whether it looks the other way than that one.
/// Halves the way.
Link root_of(Pieces& pieces, std::uint32_t facet) {
  std::uint32_t at = facet, turned = 0;
  while (pieces.number[at] != at) {
    const std::uint32_t up = pieces.number[at];
    turned ^= pieces.turned[at];
    pieces.turned[at] ^= pieces.turned[up];
    pieces.number[at] = pieces.number[up];
    at = up;
  }
  return {facet, at, turned};
}

void join(Pieces& pieces, const Link& link) {
  const Link a = root_of(pieces, link.facet), b = root_of(pieces, link.other);
  if (a.other == b.other) return;
  const std::uint32_t low = std::min(a.other, b.other), high = std::max(a.other, b.other);
  pieces.number[high] = low;
  pieces.turned[high] = static_cast<std::uint8_t>(a.turned ^ b.turned ^ link.turned);
}

/// Joins the facets of one chunk; adds what leads to earlier chunks.
void join_chunk(const SurfaceMesh& mesh, std::uint32_t begin, std::uint32_t end, Pieces& pieces,
                std::vector<Link>& links) {
  for (std::uint32_t facet = begin; facet < end; ++facet) {
    pieces.number[facet] = facet;
    for (std::uint32_t e = 0; e < 3; ++e) {
      const HalfFacet next = only_neighbour(mesh, facet, e);
      if (next == kNoFacet || facet_of(next) > facet) continue;
      const Link link{facet, facet_of(next), side_of(next)};
      if (link.other < begin)
        links.push_back(link);
      else
        join(pieces, link);
    }
  }
}

/// Most meshes: then frames look up nothing.
void give_back_what_says_nothing(Pieces& pieces) {
  if (pieces.count <= 1) std::vector<std::uint32_t>().swap(pieces.number);
  if (std::find(pieces.turned.begin(), pieces.turned.end(), 1) == pieces.turned.end())
    std::vector<std::uint8_t>().swap(pieces.turned);
}

}  // namespace

Pieces pieces_of(const SurfaceMesh& mesh, int threads) {
  Pieces pieces;
  const std::size_t facets = mesh.facets().size();
  pieces.number.resize(facets);
  pieces.turned.assign(facets, 0);
  std::vector<std::vector<Link>> links((facets + kFacetsPerChunk - 1) / kFacetsPerChunk);
  parallel_chunks(facets, kFacetsPerChunk, threads, [&](std::size_t begin, std::size_t end) {
    join_chunk(mesh, static_cast<std::uint32_t>(begin), static_cast<std::uint32_t>(end), pieces,
               links[begin / kFacetsPerChunk]);
  });
  for (const std::vector<Link>& part : links)
    for (const Link& link : part) join(pieces, link);
  // A facet points to one before it, whose own way is finished when its turn comes.
  std::vector<std::uint32_t> firsts;
  for (std::uint32_t i = 0; i < facets; ++i) {
    const std::uint32_t up = pieces.number[i];
    if (up == i) {
      firsts.push_back(i);
      continue;
    }
    pieces.turned[i] ^= pieces.turned[up];
    pieces.number[i] = pieces.number[up];
  }
  pieces.count = firsts.size();
  if (pieces.count > 1)
    for (std::uint32_t& number : pieces.number)
      number =
          static_cast<std::uint32_t>(std::lower_bound(firsts.begin(), firsts.end(), number) - firsts.begin());
  give_back_what_says_nothing(pieces);
  return pieces;
}

Pieces pieces_across_many(const SurfaceMesh& mesh) {
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
        pieces.number[facet_of(next)] = number;
        pieces.turned[facet_of(next)] = static_cast<std::uint8_t>(side_of(next));
        open.push_back(facet_of(next));
      }
    }
  }
  give_back_what_says_nothing(pieces);
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
