#include "experiments/live/stand_in.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "toolkit/cloud/cloud_subset.h"
#include "toolkit/core/random.h"
#include "toolkit/render/model_subset.h"
#include "toolkit/search/uniform_grid.h"

namespace palpate::experiments {
namespace {

constexpr const char* kStandInName = "cloud";
/// Points examined per point kept: with the right cell size a cell holds four on average, and e^-4, one in
/// fifty of the surface's cells, holds none.
constexpr std::size_t kLookedAtForOne = 4;
constexpr std::uint64_t kLookSeed = 20'161'123;
/// Cell sizes tried. The number of surface cells falls with the square of the edge, so the second is nearly
/// right; rough surfaces need another.
constexpr int kCellTries = 3;
constexpr int kThinThreads = 1;

/// One index from each run, so every part of a file is sampled.
std::vector<std::uint32_t> one_of_each_run(std::size_t n, std::size_t runs) {
  std::vector<std::uint32_t> looked;
  looked.reserve(runs);
  Random random(kLookSeed);
  for (std::size_t run = 0; run < runs; ++run) {
    const std::size_t begin = run * n / runs, end = (run + 1) * n / runs;
    looked.push_back(static_cast<std::uint32_t>(begin + random.below(end - begin)));
  }
  return looked;
}

/// The first point of every cell.
std::vector<std::uint32_t> one_of_each_cell(const cloud::Cloud& cloud, const search::UniformGrid& grid) {
  std::vector<std::uint32_t> firsts;
  search::Cell last{-1, -1, -1};
  for (const std::uint32_t point : grid.order()) {
    const search::Cell cell = grid.cell_of(cloud.local_mm(point));
    if (cell.x != last.x || cell.y != last.y || cell.z != last.z) firsts.push_back(point);
    last = cell;
  }
  std::sort(firsts.begin(), firsts.end());
  return firsts;
}

/// A grid in which about `cells` cells hold points.
search::UniformGrid grid_of_cells(const cloud::Cloud& cloud, std::size_t cells) {
  const Vec3 extent = cloud.box_mm().extent_mm();
  // Initial guess: all points on one face of the box.
  double cell_mm = extent.norm() / std::sqrt(static_cast<double>(cells));
  search::UniformGrid grid = search::UniformGrid::build(cloud, cell_mm, kThinThreads);
  for (int tried = 1; tried < kCellTries; ++tried) {
    cell_mm *= std::sqrt(static_cast<double>(grid.occupied_cells()) / static_cast<double>(cells));
    grid = search::UniformGrid::build(cloud, cell_mm, kThinThreads);
  }
  return grid;
}

}  // namespace

std::vector<std::uint32_t> thinned(const cloud::Cloud& cloud, std::size_t points) {
  const std::size_t most = std::max<std::size_t>(points, 1);
  std::vector<std::uint32_t> looked =
      one_of_each_run(cloud.size(), std::min(cloud.size(), kLookedAtForOne * most));
  if (cloud.size() <= most) return looked;
  const cloud::Cloud some = cloud::subset_of(cloud, looked);
  std::vector<std::uint32_t> kept;
  for (const std::uint32_t place : one_of_each_cell(some, grid_of_cells(some, most)))
    kept.push_back(looked[place]);
  return kept;
}

std::string StandIn::text() const {
  return fmt::format("{} on {} of {} points", request.name, points, of_points);
}

std::optional<StandIn> stand_in_for(const LiveArguments& arguments, const std::vector<LiveSetting>& settings,
                                    const render::SceneInput& scene, const render::Registry& registry) {
  const auto wanted = static_cast<std::size_t>(arguments.stand_in);
  if (arguments.link == nullptr || arguments.accelerated || !arguments.record.empty() || wanted == 0)
    return std::nullopt;
  StandIn stand_in;
  for (const render::ModelInput& model : scene.models) {
    if (model.surface.dent.any() || model.moves) return std::nullopt;
    stand_in.of_points += model.cloud->size();
  }
  if (stand_in.of_points <= wanted) return std::nullopt;
  stand_in.input = scene;
  const double share = static_cast<double>(wanted) / static_cast<double>(stand_in.of_points);
  for (render::ModelInput& model : stand_in.input.models) {
    const double points = std::ceil(share * static_cast<double>(model.cloud->size()));
    model = render::subset_of(model, thinned(*model.cloud, static_cast<std::size_t>(points)));
    stand_in.points += model.cloud->size();
  }
  const render::RendererInfo* first = registry.find(settings.front().request.name);
  if (first != nullptr && first->name.starts_with(kStandInName))
    stand_in.request = settings.front().request;
  else
    stand_in.request = {kStandInName, kStandInName, {}};
  const render::RendererInfo* info = registry.find(stand_in.request.name);
  if (info == nullptr || !registry.check_supports(*info, stand_in.input)) return std::nullopt;
  return stand_in;
}

LiveRenderer described(const LiveSetting& setting, const MadeRenderer& made) {
  LiveRenderer shown;
  shown.label = setting.request.label;
  shown.name = setting.request.name;
  const render::Description words = made.renderer->describe();
  for (const auto& [key, value] : words.options.all()) shown.options.emplace_back(key, value);
  shown.prepare_ms = made.report.total_ms;
  shown.bytes = made.report.bytes;
  shown.shared_bytes = made.report.shared_bytes;
  return shown;
}

}  // namespace palpate::experiments
