#include "experiments/live/changes.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include <palpate/result.h>
#include "experiments/run/stage.h"
#include "toolkit/cloud/statistics.h"
#include "toolkit/core/messages.h"
#include "toolkit/core/random.h"
#include "toolkit/core/tolerances.h"
#include "toolkit/render/prepare.h"
#include "toolkit/search/uniform_grid.h"

namespace palpate::experiments {
namespace {

constexpr const char* kStiffnessKey = "stiffness";
constexpr const char* kForceLimitKey = "force_limit";
constexpr const char* kChangeForm = "write SECONDS:LABEL:key=value[:key=value..], separated by commas";

Result<render::SceneInput> scene_for(const Workshop& workshop, const LiveSetting& setting,
                                     Progress& progress) {
  render::SceneInput scene = workshop.other != nullptr ? *workshop.other : workshop.stage.scene.input;
  if (!setting.request.clean.empty()) {
    PALPATE_ASSIGN(CleanedScene cleaned,
                   clean_scene(scene, setting.request.clean, workshop.threads, progress));
    scene = std::move(cleaned.input);
  }
  if (setting.stiffness_n_per_mm > 0.0)
    for (render::ModelInput& model : scene.models)
      model.surface.stiffness_n_per_mm = setting.stiffness_n_per_mm;
  if (setting.force_limit_n >= 0.0) scene.force_limit_n = setting.force_limit_n;
  return scene;
}

Error wrong_change(const std::string& part, std::string what) {
  return Error{fmt::format("--changes has {}: {}", shown(part), std::move(what)), kChangeForm};
}

Status set_key(const std::string& part, const std::string& word, LiveSetting& setting) {
  constexpr NumberRange kLimit{0.0, kForcesN.high};  // 0: no limit
  const std::size_t equals = word.find('=');
  if (equals == std::string::npos) return wrong_change(part, shown(word) + " is no key=value");
  const std::string key = word.substr(0, equals), value = word.substr(equals + 1);
  if (key != kStiffnessKey && key != kForceLimitKey) {
    setting.request.options.set(key, value);
    return Done{};
  }
  const bool stiffness = key == kStiffnessKey;
  const Result<double> number = read_number(value, stiffness ? kStiffnessesNPerMm : kLimit);
  if (!number) return wrong_change(part, number.error().what);
  (stiffness ? setting.stiffness_n_per_mm : setting.force_limit_n) = *number;
  return Done{};
}

}  // namespace

Result<MadeRenderer> make_live(Workshop& workshop, const LiveSetting& setting, Progress& progress) {
  PALPATE_ASSIGN(const render::SceneInput scene, scene_for(workshop, setting, progress));
  PALPATE_ASSIGN(std::unique_ptr<render::HapticRenderer> made,
                 workshop.registry.make(setting.request.name, setting.request.options));
  MadeRenderer ready;
  ready.renderer = control::wrap(std::move(made), workshop.around_each());
  render::PrepareContext context{workshop.threads, &progress};
  context.store = &workshop.store;
  context.paced = workshop.paced;
  PALPATE_ASSIGN(ready.report, ready.renderer->prepare(scene, context));
  return ready;
}

Result<std::vector<stream::DepthReceiver*>> receivers_of(const std::vector<MadeRenderer>& made) {
  std::vector<stream::DepthReceiver*> receivers;
  for (const MadeRenderer& one : made) {
    receivers.push_back(one.renderer->depth_receiver());
    if (receivers.back() == nullptr)
      return Error{one.renderer->describe().name + " takes no depth images",
                   "choose depth-image, stream-proxy or mesh-godobject"};
  }
  return receivers;
}

Result<std::vector<LiveChange>> parse_changes(const std::string& text,
                                              const std::vector<LiveSetting>& at_start,
                                              const render::Registry& registry) {
  std::vector<LiveChange> changes;
  std::vector<LiveSetting> now = at_start;
  if (text.empty()) return changes;
  for (const std::string& part : split_list(text)) {
    const std::vector<std::string> words = split_list(part, ':');
    if (words.size() < 3) return wrong_change(part, "it has no time, label and key");
    const Result<double> at_s = read_number(words[0], kTimesS);
    if (!at_s) return wrong_change(part, at_s.error().what);
    if (!changes.empty() && *at_s < changes.back().at_s)
      return wrong_change(part, "it comes before the one before it");
    std::vector<std::string> labels;
    for (const LiveSetting& setting : now) labels.push_back(setting.request.label);
    const auto found = std::find(labels.begin(), labels.end(), words[1]);
    if (found == labels.end())
      return wrong_change(part,
                          fmt::format("there is no renderer '{}'; there are {}", words[1], joined(labels)));
    const auto lane = static_cast<std::size_t>(found - labels.begin());
    for (std::size_t k = 2; k < words.size(); ++k) PALPATE_TRY(set_key(part, words[k], now[lane]));
    if (const auto able = registry.make(now[lane].request.name, now[lane].request.options); !able)
      return wrong_change(part, able.error().message());
    changes.push_back({*at_s, lane, now[lane]});
  }
  return changes;
}

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
    if (model.surface.dent.any() || model.moves || model.camera) return std::nullopt;
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
