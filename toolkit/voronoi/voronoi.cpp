#include "toolkit/voronoi/voronoi.h"

#include <fmt/format.h>

#include <algorithm>
#include <exception>
#include <vector>

#include <palpate/registry.h>
#include <palpate/result.h>
#include "toolkit/cloud/statistics.h"
#include "toolkit/core/parallel.h"
#include "toolkit/search/knn.h"
#include "toolkit/search/knn_kernels.h"

#include <CGAL/Delaunay_triangulation_3.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Triangulation_data_structure_3.h>
#include <CGAL/Triangulation_vertex_base_with_info_3.h>

namespace palpate::voronoi {
namespace {

using search::kNeighbours;
using search::NeighbourTable;
using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Vertex = CGAL::Triangulation_vertex_base_with_info_3<std::uint32_t, Kernel>;
using Cell = CGAL::Delaunay_triangulation_cell_base_3<Kernel>;
using Triangulation =
    CGAL::Delaunay_triangulation_3<Kernel, CGAL::Triangulation_data_structure_3<Vertex, Cell>>;

/// Of one place no point needs more than itself and eight others.
constexpr std::size_t kOfOnePlace = kNeighbours + 1;

/// Lists of lists in two arrays.
struct Rows {
  std::vector<std::uint32_t> begin, values;
  [[nodiscard]] auto first(std::size_t i) const noexcept { return values.begin() + begin[i]; }
  [[nodiscard]] auto last(std::size_t i) const noexcept { return values.begin() + begin[i + 1]; }
};

/// Points by place, the lowest index first in each.
struct Places {
  Rows members;
  std::vector<std::uint32_t> of;  ///< place of each point
  [[nodiscard]] std::size_t size() const noexcept { return members.begin.size() - 1; }
};

Places places_of(const cloud::Cloud& cloud) {
  const auto at = [&](std::uint32_t i) { return std::array{cloud.x_mm[i], cloud.y_mm[i], cloud.z_mm[i]}; };
  Places places;
  std::vector<std::uint32_t>& order = places.members.values;
  order = cloud::indices_by_place(cloud);
  places.of.resize(cloud.size());
  for (std::uint32_t k = 0; k < order.size(); ++k) {
    if (k == 0 || at(order[k]) != at(order[k - 1])) places.members.begin.push_back(k);
    places.of[order[k]] = static_cast<std::uint32_t>(places.members.begin.size() - 1);
  }
  places.members.begin.push_back(static_cast<std::uint32_t>(order.size()));
  return places;
}

/// The ends of the edges of the triangulation, for each point.
Links links_of(const Triangulation& triangulation, std::size_t count) {
  const auto end_of = [](const Triangulation::Edge& edge, int which) {
    return edge.first->vertex(which)->info();
  };
  Links links;
  links.begin.assign(count + 1, 0);
  if (triangulation.dimension() < 1) return links;
  for (auto edge = triangulation.finite_edges_begin(); edge != triangulation.finite_edges_end(); ++edge) {
    ++links.begin[end_of(*edge, edge->second) + 1];
    ++links.begin[end_of(*edge, edge->third) + 1];
  }
  std::partial_sum(links.begin.begin(), links.begin.end(), links.begin.begin());
  links.ends.resize(links.begin.back());
  std::vector<std::uint32_t> at(links.begin.begin(), links.begin.end() - 1);
  for (auto edge = triangulation.finite_edges_begin(); edge != triangulation.finite_edges_end(); ++edge) {
    const std::uint32_t a = end_of(*edge, edge->second), b = end_of(*edge, edge->third);
    links.ends[at[a]++] = b;
    links.ends[at[b]++] = a;
  }
  return links;
}

/// The places whose cells touch, for each place. The call may throw.
template <class At>
Links touching(std::size_t count, const At& at) {
  std::vector<std::pair<Kernel::Point_3, std::uint32_t>> points;
  points.reserve(count);
  for (std::uint32_t place = 0; place < count; ++place) {
    const Vec3 p = at(place);
    points.emplace_back(Kernel::Point_3(p.x(), p.y(), p.z()), place);
  }
  return links_of(Triangulation(points.begin(), points.end()), count);
}

/// work() with what CGAL throws as an Error: nothing of ours throws.
template <class Work>
auto caught(std::size_t points, const char* remedy, const Work& work) -> decltype(work()) {
  try {
    return work();
  } catch (const std::bad_alloc&) {
    return Error{fmt::format("there is not enough memory for the Voronoi cells of {} points", points),
                 std::string(remedy) + ", or reduce the cloud"};
  } catch (const std::exception& thrown) {
    return Error{fmt::format("CGAL gave up on the Voronoi cells: {}", thrown.what()), remedy};
  }
}

NeighbourTable nearest_eight(const cloud::Cloud& cloud, const Places& places, const Links& natural,
                             int threads, VoronoiReport& report) {
  NeighbourTable table;
  table.of.resize(cloud.size());
  const auto visit = [&](std::size_t i, VoronoiReport& part) {
    const auto self = static_cast<std::uint32_t>(i);
    const Vec3 p = cloud.local_mm(self);
    search::NearestEight best;
    std::size_t found = 0;
    const auto offer = [&](std::uint32_t place) {
      const auto first = places.members.first(place), last = places.members.last(place);
      found += static_cast<std::size_t>(last - first);
      for (auto m = first; m != last && m < first + kOfOnePlace; ++m)
        if (*m != self) best.offer((cloud.local_mm(*m) - p).squaredNorm(), *m);
    };
    const std::uint32_t home = places.of[self];
    offer(home);
    --found;  // itself
    for (const std::uint32_t other : natural.of(home)) offer(other);
    best.store(self, table.of[self]);
    part.more_than_eight += found > kNeighbours;
    part.fewer_than_eight += found < kNeighbours;
  };
  report.places = places.size();
  report.natural = natural.ends.size() / 2;
  for (const auto& part : parallel_parts<VoronoiReport>(cloud.size(), kPointsPerChunk, threads, visit)) {
    report.more_than_eight += part.more_than_eight;
    report.fewer_than_eight += part.fewer_than_eight;
  }
  return table;
}

}  // namespace

Result<NeighbourTable> voronoi(const cloud::Cloud& cloud, int threads, VoronoiReport* report) {
  if (cloud.empty()) return NeighbourTable{};
  return caught(cloud.size(), "choose neighbours=exact-knn", [&]() -> Result<NeighbourTable> {
    VoronoiReport found;
    const Places places = places_of(cloud);
    const Links natural =
        touching(places.size(), [&](std::uint32_t p) { return cloud.local_mm(*places.members.first(p)); });
    NeighbourTable table = nearest_eight(cloud, places, natural, threads, found);
    if (report != nullptr) *report = found;
    return table;
  });
}

Result<Links> natural_links(std::span<const Vec3> points) {
  return caught(points.size(), "choose another graph", [&]() -> Result<Links> {
    return touching(points.size(), [&](std::uint32_t i) { return points[i]; });
  });
}

void register_voronoi() {
  search::NeighbourBuilder builder;
  builder.name = "voronoi";
  builder.summary = "the nearest eight of those whose Voronoi cells touch";
  builder.source = "section 3.2.2.3, CGAL";
  builder.build = [](const cloud::Cloud& cloud, const Options&,
                     int threads) -> Result<search::NeighbourBuild> {
    VoronoiReport r;
    PALPATE_ASSIGN(NeighbourTable table, voronoi(cloud, threads, &r));
    search::NeighbourBuild built{std::move(table), {}};
    built.notes.push_back(fmt::format("{:.2f} natural neighbours on average, fewer than eight at {} points",
                                      2.0 * static_cast<double>(r.natural) / static_cast<double>(r.places),
                                      r.fewer_than_eight));
    return built;
  };
  builder.one_thread = true;
  search::add_neighbour_builder(std::move(builder));
}

}  // namespace palpate::voronoi
