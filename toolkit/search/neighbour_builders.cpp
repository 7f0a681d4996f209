#include "toolkit/search/knn.h"

#include <fmt/format.h>

#include <algorithm>
#include <mutex>

#include <palpate/result.h>
#include "toolkit/cloud/statistics.h"
#include "toolkit/core/messages.h"
#include "toolkit/core/option_specs.h"

namespace palpate::search {
namespace {

/// Two local spacings: a square grid on a 60-degree slope keeps its eight.
constexpr const char* kCutOff = "2";

NeighbourBuilder exact() {
  return {"exact-knn",
          "the eight nearest points",
          "section 3.2.2.1",
          {},
          [](const cloud::Cloud& cloud, const Options&, int threads) -> Result<NeighbourBuild> {
            return NeighbourBuild{exact_knn(cloud, threads), {}};
          }};
}

NeighbourBuilder density() {
  return {"density-knn",
          "the eight nearest, without those farther than the density suggests",
          "section 3.2.2.1",
          {option::number("cutoff", kCutOff, "farthest neighbour in local spacings", 0.01, 1e6)},
          [](const cloud::Cloud& cloud, const Options& options, int threads) -> Result<NeighbourBuild> {
            NeighbourBuild built{exact_knn(cloud, threads), {}};
            const CutOffReport r = cut_off_by_density(cloud, built.table, options.number("cutoff"), threads);
            if (r.links_cut > 0)
              built.notes.push_back(fmt::format(
                  "{} links of {} points are too long for the density around, {} points have none left",
                  r.links_cut, r.points_cut, r.points_without));
            return built;
          }};
}

NeighbourBuilder connected() {
  return {"connected-knn",
          "the eight nearest, with links that reach every point from the first",
          "section 3.2.2.1",
          {},
          [](const cloud::Cloud& cloud, const Options&, int threads) -> Result<NeighbourBuild> {
            ConnectReport r;
            NeighbourBuild built{connected_knn(cloud, threads, &r), {}};
            if (r.links_given > 0)
              built.notes.push_back(
                  fmt::format("{} pieces, {} points out of reach: {} links given, the longest {:.4g} mm",
                              r.pieces, r.unreached, r.links_given, r.longest_link_mm));
            return built;
          }};
}

NeighbourBuilder directional() {
  return {"directional-knn",
          "the nearest point in each of eight directions",
          "section 3.2.2.1, figure 39",
          {option::choice("frame", "tangent", "plane of the directions: the local fit, or x and y",
                          {"tangent", "plan"}),
           option::number("reach", "3", "how far to look, in distances to the eighth nearest", 1.0, 1e3),
           option::number("steepest_deg", "45", "largest angle off the plane, degrees", 1.0, 90.0)},
          [](const cloud::Cloud& cloud, const Options& options, int threads) -> Result<NeighbourBuild> {
            DirectionalKnnOptions o;
            o.frame = options.text("frame") == "plan" ? DirectionalKnnOptions::Frame::kPlan
                                                      : DirectionalKnnOptions::Frame::kTangent;
            o.reach = options.number("reach");
            o.steepest_deg = options.number("steepest_deg");
            DirectionalKnnReport r;
            NeighbourBuild built{directional_knn(cloud, o, threads, &r), {}};
            if (r.empty_directions > 0)
              built.notes.push_back(fmt::format("{} of {} points have all eight directions, {} are empty",
                                                r.all_eight, cloud.size(), r.empty_directions));
            return built;
          }};
}

NeighbourBuilder fixed() {
  return {"fixed-distance",
          "all points within a distance, the nearest eight kept",
          "section 3.2.2.2",
          {option::number("distance_mm", "0", "mm; 0: 1.68 mean spacings", 0.0, 1e300)},
          [](const cloud::Cloud& cloud, const Options& options, int threads) -> Result<NeighbourBuild> {
            FixedDistanceReport r;
            NeighbourBuild built{fixed_distance(cloud, {options.number("distance_mm")}, threads, &r), {}};
            built.notes.push_back(
                fmt::format("within {:.4g} mm: more than eight at {} points, fewer at {}, {:.2f} on average",
                            r.distance_mm, r.more_than_eight, r.fewer_than_eight,
                            static_cast<double>(r.within) / static_cast<double>(cloud.size())));
            return built;
          }};
}

NeighbourBuilder scanner() {
  NeighbourBuilder builder{
      "scanner-path",
      "the eight around in the scanner's order",
      "section 3.2.2.4",
      {},
      [](const cloud::Cloud& cloud, const Options&, int threads) -> Result<NeighbourBuild> {
        const auto found = cloud.raster ? std::nullopt : cloud::find_raster(cloud);
        PALPATE_ASSIGN(NeighbourTable table,
                       found ? scanner_path(cloud, *found, threads) : scanner_path(cloud, threads));
        NeighbourBuild built{std::move(table), {}};
        if (found) built.notes.emplace_back("the scanner's order was recognised from the points");
        return built;
      }};
  builder.follows_scanner = true;
  return builder;
}

NeighbourBuilder lookup() {
  NeighbourBuilder builder{
      "lookup-table",
      "the eight around by each point's scan, row and column, across holes",
      "section 3.6.1",
      {option::integer("across", "2", "missing positions that a link may pass over", 0, 1000)},
      [](const cloud::Cloud& cloud, const Options& options, int threads) -> Result<NeighbourBuild> {
        PALPATE_ASSIGN(const ScanTable positions, scan_table_of(cloud));
        LookupReport r;
        PALPATE_ASSIGN(NeighbourTable table,
                       lookup_table(cloud, positions, {static_cast<std::uint32_t>(options.integer("across"))},
                                    threads, &r));
        NeighbourBuild built{std::move(table), {}};
        if (r.links_across_holes > 0)
          built.notes.push_back(fmt::format("{} links pass over holes, {} points have fewer than eight",
                                            r.links_across_holes, r.fewer_than_eight));
        return built;
      }};
  builder.follows_scanner = true;
  return builder;
}

NeighbourBuilder modified() {
  return {"modified-knn",
          "the points of a shrinking block of cubes",
          "section 3.2.2.5",
          {option::flag("complete", "true", "complete to eight neighbours; false: as printed"),
           option::number("start_size", "1", "first cube edge in mean spacings", 1e-3, 1e3),
           option::number("refinement", "0.70710678118654752", "factor between sizes", 0.1, 0.99),
           option::number("growth_limit", "64", "largest cube edge in units of the first", 1.0, 1e6)},
          [](const cloud::Cloud& cloud, const Options& options, int threads) -> Result<NeighbourBuild> {
            ModifiedKnnOptions o;
            o.complete_to_eight = options.flag("complete");
            o.start_size = options.number("start_size");
            o.refinement = options.number("refinement");
            o.growth_limit = options.number("growth_limit");
            ModifiedKnnReport r;
            NeighbourBuild built{modified_knn(cloud, o, threads, &r), {}};
            if (r.fewer_than_eight > 0) {
              std::size_t none = 0;
              for (std::size_t i = 0; i < built.table.size(); ++i) none += built.table.count(i) == 0;
              built.notes.push_back(
                  fmt::format("{} points have fewer than eight neighbours, {} none{}", r.fewer_than_eight,
                              none, o.complete_to_eight ? "" : "; complete=true gives them eight"));
            }
            return built;
          }};
}

struct Registered {
  std::mutex gate;
  std::vector<NeighbourBuilder> all = {exact(), density(), connected(), directional(),
                                       fixed(), scanner(), lookup(),    modified()};
};

Registered& registered() {
  static Registered builders;
  return builders;
}

}  // namespace

std::vector<NeighbourBuilder> neighbour_builders() {
  Registered& known = registered();
  const std::lock_guard lock(known.gate);
  return known.all;
}

void add_neighbour_builder(NeighbourBuilder builder) {
  Registered& known = registered();
  const std::lock_guard lock(known.gate);
  const auto same = std::find_if(known.all.begin(), known.all.end(),
                                 [&](const NeighbourBuilder& b) { return b.name == builder.name; });
  if (same == known.all.end())
    known.all.push_back(std::move(builder));
  else
    *same = std::move(builder);
}

Result<NeighbourBuild> build_neighbours(const NamedOptions& wanted, const cloud::Cloud& cloud, int threads) {
  if (cloud.empty()) return Error{"the cloud has no points", "give a file with at least one point"};
  for (const NeighbourBuilder& builder : neighbour_builders()) {
    if (builder.name != wanted.name) continue;
    PALPATE_ASSIGN(const Options options, validate(wanted.options, builder.options, builder.name));
    return builder.build(cloud, options, threads);
  }
  return Error{fmt::format("there is no neighbour builder '{}'", wanted.name),
               "choose from " + joined(names_of(neighbour_builders()))};
}

Result<NeighbourBuild> build_neighbours(std::string_view name_and_options, const cloud::Cloud& cloud,
                                        int threads) {
  PALPATE_ASSIGN(const NamedOptions wanted, parse_named_options(name_and_options));
  return build_neighbours(wanted, cloud, threads);
}

}  // namespace palpate::search
