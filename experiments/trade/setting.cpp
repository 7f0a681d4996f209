#include "experiments/trade/measure.h"

#include <fmt/format.h>

#include <algorithm>
#include <set>

#include "experiments/run/stage.h"
#include "toolkit/core/messages.h"

namespace palpate::experiments {
namespace {

// Factors of a default number; the second list is for --full.
constexpr double kFactors[] = {0.5, 2.0};
constexpr double kMoreFactors[] = {0.25, 4.0};
// Box sizes in resolutions. At 1 no segment slips through; at 0.5 it may; at 2 the box holds the neighbours
// too.
constexpr double kBoxes[] = {0.5, 2.0};
constexpr double kMoreBoxes[] = {1.5, 4.0};
// Grid cells in resolutions; the default is five.
constexpr double kCells[] = {2.0, 10.0};
constexpr double kMoreCells[] = {1.0, 20.0};
// Thinning cells in spacings, one point kept in each: about half, a fifth of the points.
constexpr double kThinned[] = {1.5, 2.5};
constexpr double kMoreThinned[] = {1.25, 4.0};
// Shares of the facets.
constexpr double kLevels[] = {0.5, 0.1};
constexpr double kMoreLevels[] = {0.25, 0.02};
// Bits of the largest extent; 16 is the resolution of 16-bit coordinates.
constexpr int kBits[] = {16, 12};
constexpr int kMoreBits[] = {20, 10};
// Divisors of a 1 kHz path: 500 and 250 Hz.
constexpr int kDivisors[] = {2, 4};
constexpr int kMoreDivisors[] = {8};
// Axes varied at once. Three of some forty values per renderer are ten thousand settings, a night on a
// cluster.
constexpr std::size_t kMostCrossed = 2, kMostCrossedFull = 3;

/// One value on an axis and its change.
struct Turn {
  std::size_t axis = 0;
  std::vector<std::pair<std::string, std::string>> options;
  std::string clean;
  int bits = 0;
  int divisor = 1;
};

std::size_t axis_at(std::string_view name) {
  const std::vector<Axis>& all = axes();
  const auto at = std::find_if(all.begin(), all.end(), [&](const Axis& a) { return a.name == name; });
  return static_cast<std::size_t>(at - all.begin());
}

struct AxisKeys {
  const char* axis;
  std::vector<const char*> keys;
};
const std::vector<AxisKeys>& option_axes() {
  static const std::vector<AxisKeys> kAll = {
      {"neighbours", {"neighbours"}},
      {"box", {"box", "box_mm", "test"}},
      {"cell", {"cell"}},
      {"partition", {"partition"}},
      {"shading", {"shading"}},
      {"surface", {"refine", "surface", "graph", "side", "weight", "weights"}},
      {"detail", {"detail", "width", "level"}},
      {"voxel", {"voxel", "radius"}},
      {"bounds", {"walk_steps", "ticks", "iterations"}},
      {"mesh", {"mesh"}},
      {"level", {"decimate"}},
  };
  return kAll;
}

template <class T, std::size_t N, std::size_t M>
std::vector<T> values(const T (&usual)[N], const T (&more)[M], bool full) {
  std::vector<T> all(usual, usual + N);
  if (full) all.insert(all.end(), more, more + M);
  return all;
}

std::vector<std::string> numbers_of(const OptionSpec& spec, const SettingsRequest& request) {
  std::vector<double> numbers;
  const double usual = parse_number(spec.default_value).value();
  if (spec.key == "box_mm") {
    for (const double x : values(kBoxes, kMoreBoxes, request.full))
      numbers.push_back(x * request.resolution_mm);
  } else if (spec.key == "cell") {
    numbers = values(kCells, kMoreCells, request.full);
  } else if (spec.key == "decimate") {
    numbers = values(kLevels, kMoreLevels, request.full);
  } else if (spec.key == "refine") {
    for (double x = 1.0; x <= (request.full ? spec.high : 1.0); ++x) numbers.push_back(x);
  } else {
    for (const double x : values(kFactors, kMoreFactors, request.full)) numbers.push_back(x * usual);
  }
  std::vector<std::string> texts;
  for (double x : numbers) {
    if (spec.kind == OptionKind::kInteger) x = std::max(1.0, std::floor(x));
    x = std::clamp(x, spec.low, spec.high);
    std::string text = fmt::format("{:.4g}", x);
    if (x != usual && std::find(texts.begin(), texts.end(), text) == texts.end())
      texts.push_back(std::move(text));
  }
  return texts;
}

std::vector<std::string> values_of(const OptionSpec& spec, const SettingsRequest& request) {
  switch (spec.kind) {
    case OptionKind::kNumber:
    case OptionKind::kInteger:
      return numbers_of(spec, request);
    case OptionKind::kChoice: {
      std::vector<std::string> others = spec.choices;
      std::erase(others, spec.default_value);
      return others;
    }
    case OptionKind::kFlag:
      return {spec.default_value == "true" ? "false" : "true"};
    case OptionKind::kText:
      break;
  }
  return {};
}

bool all_have(const render::SceneInput& scene, bool (*what)(const render::ModelInput&)) {
  return std::all_of(scene.models.begin(), scene.models.end(), what);
}

/// True if the models have what a value needs: their own faces, or a scanner's raster.
bool can_be_had(const OptionSpec& spec, const std::string& value, const render::SceneInput& scene) {
  const bool raster =
      all_have(scene, [](const render::ModelInput& m) { return m.cloud->raster.has_value(); });
  const bool faces = all_have(scene, [](const render::ModelInput& m) { return m.original_mesh != nullptr; });
  if (spec.key == "mesh") return (value != "original" || faces) && (value != "organised" || raster);
  if (spec.key == "neighbours") return raster || (value != "scanner-path" && value != "lookup-table");
  return true;
}

/// All variations of one renderer, by axis.
std::vector<Turn> turns_of(const RendererRequest& base, const render::RendererInfo& info,
                           const SettingsRequest& request, const render::SceneInput& scene) {
  const auto wanted = [&](std::string_view name) {
    return std::find(request.axes.begin(), request.axes.end(), name) != request.axes.end();
  };
  std::vector<Turn> turns;
  for (const AxisKeys& axis : option_axes()) {
    if (!wanted(axis.axis)) continue;
    for (const char* key : axis.keys)
      for (const OptionSpec& spec : info.options) {
        // Given options stay fixed.
        if (spec.key != key || base.options.has(key)) continue;
        for (std::string& value : values_of(spec, request))
          if (can_be_had(spec, value, scene))
            turns.push_back({axis_at(axis.axis), {{spec.key, std::move(value)}}, {}, 0, 1});
      }
  }
  if (wanted("points") && base.clean.empty() && all_cleaning().find("thin") != nullptr)
    for (const double cell : values(kThinned, kMoreThinned, request.full))
      turns.push_back({axis_at("points"), {}, fmt::format("thin/cell={}", cell), 0, 1});
  if (wanted("precision"))
    for (const int bits : values(kBits, kMoreBits, request.full))
      turns.push_back({axis_at("precision"), {}, {}, bits, 1});
  if (wanted("rate"))
    for (const int divisor : values(kDivisors, kMoreDivisors, request.full))
      turns.push_back({axis_at("rate"), {}, {}, 0, divisor});
  return turns;
}

/// `base` with all these variations; empty if the renderer refuses it.
std::optional<Setting> turned_setting(const RendererRequest& base, std::span<const Turn* const> turns,
                                      const render::Registry& registry) {
  NamedOptions named{base.name, base.options};
  if (!base.clean.empty()) named.options.set("clean", cleaning_text(base.clean));
  Setting setting;
  for (const Turn* turn : turns) {
    for (const auto& [key, value] : turn->options) named.options.set(key, value);
    if (!turn->clean.empty()) named.options.set("clean", turn->clean);
    if (turn->bits > 0) setting.precision_bits = turn->bits;
    if (turn->divisor > 1) setting.rate_divisor = turn->divisor;
    setting.axes.push_back(axes()[turn->axis].name);
  }
  setting.given = named.options;
  setting.text = named.name;
  for (const auto& [key, value] : named.options.all()) setting.text += fmt::format(":{}={}", key, value);
  Result<RendererRequest> request = request_of(std::move(named), registry);
  if (!request) return std::nullopt;
  setting.request = *std::move(request);
  if (setting.precision_bits > 0) setting.text += fmt::format(":precision_bits={}", setting.precision_bits);
  if (setting.rate_divisor > 1) setting.text += fmt::format(":rate_divisor={}", setting.rate_divisor);
  setting.request.label = setting.text;
  return setting;
}

/// All renderers for the scene, ours and the mesh god object first in case time runs out.
std::vector<RendererRequest> all_bases(const render::SceneInput& scene, const render::Registry& registry) {
  std::vector<std::string> texts = {"cloud", "cloud-smooth", "mesh-godobject", "cloud-vertices",
                                    "heightfield"};
  for (const render::RendererInfo& info : registry.all())
    if (std::find(texts.begin(), texts.end(), info.name) == texts.end() &&
        info.role != render::Role::kReference && info.role != render::Role::kOracle &&
        info.geometry != render::Geometry::kFormula)
      texts.push_back(info.name);
  std::vector<RendererRequest> bases;
  for (const std::string& text : texts) {
    Result<NamedOptions> named = parse_named_options(text);
    if (!named || registry.find(named->name) == nullptr) continue;
    Result<RendererRequest> request = request_of(*std::move(named), registry);
    if (!request) continue;
    const render::RendererInfo& info = *registry.find(request->name);
    const bool fits = info.geometry != render::Geometry::kHeights ||
                      (scene.models.size() == 1 && scene.models.front().cloud->raster.has_value());
    if (fits && registry.check_supports(info, scene)) bases.push_back(*std::move(request));
  }
  return bases;
}

/// Appends one renderer's settings with `count` variations at once.
void cross(const RendererRequest& base, const std::vector<Turn>& turns, std::size_t count,
           const render::Registry& registry, std::vector<const Turn*>& chosen, std::size_t from,
           std::vector<Setting>& settings) {
  if (chosen.size() == count) {
    if (std::optional<Setting> setting = turned_setting(base, chosen, registry))
      settings.push_back(*std::move(setting));
    return;
  }
  for (std::size_t i = from; i < turns.size(); ++i) {
    // At most one value per axis, in the order of the axes.
    if (!chosen.empty() && chosen.back()->axis >= turns[i].axis) continue;
    chosen.push_back(&turns[i]);
    cross(base, turns, count, registry, chosen, i + 1, settings);
    chosen.pop_back();
  }
}

}  // namespace

const std::vector<Axis>& axes() {
  static const std::vector<Axis> kAll = {
      {"neighbours", "how neighbours are found"},
      {"box", "size and kind of the points' boxes, and how they are tested"},
      {"cell", "edge of the grid's cells"},
      {"partition", "grid, octree or quadtree"},
      {"shading", "of the force"},
      {"surface", "what is felt between the points: refinement, weights, graphs"},
      {"detail", "how much is taken for shape and how much for noise"},
      {"voxel", "voxels, radii"},
      {"bounds", "of walks and solvers"},
      {"mesh", "how a mesh is made"},
      {"level", "share of the facets that are kept"},
      {"points", "share of the points that are kept"},
      {"precision", "bits of a coordinate"},
      {"rate", "of the loop"},
  };
  return kAll;
}

Result<std::vector<std::string>> parse_axes(const std::string& text) {
  std::vector<std::string> names;
  for (const Axis& axis : axes()) names.push_back(axis.name);
  if (text.empty()) return names;
  std::vector<std::string> chosen;
  for (const std::string& name : split_list(text)) {
    if (std::find(names.begin(), names.end(), name) == names.end())
      return Error{fmt::format("there is no axis {}", shown(name)),
                   did_you_mean(name, names, "choose from " + joined(names))};
    if (std::find(chosen.begin(), chosen.end(), name) != chosen.end())
      return Error{fmt::format("the axis '{}' is named twice", name), "name each once"};
    chosen.push_back(name);
  }
  return chosen;
}

std::vector<Setting> settings_of(const SettingsRequest& request, const render::SceneInput& scene,
                                 const render::Registry& registry) {
  std::vector<RendererRequest> bases = request.renderers;
  if (bases.empty()) bases = all_bases(scene, registry);
  std::vector<std::vector<Turn>> turns;
  for (const RendererRequest& base : bases)
    turns.push_back(turns_of(base, *registry.find(base.name), request, scene));
  const std::size_t most = request.full ? kMostCrossedFull : kMostCrossed;
  std::vector<Setting> all;
  std::set<std::string> known;
  for (std::size_t count = 0; count <= most; ++count) {
    std::vector<Setting> found;
    for (std::size_t b = 0; b < bases.size(); ++b) {
      std::vector<const Turn*> chosen;
      cross(bases[b], turns[b], count, registry, chosen, 0, found);
    }
    for (Setting& setting : found)
      if (known.insert(setting.text).second) all.push_back(std::move(setting));
  }
  return all;
}

}  // namespace palpate::experiments
