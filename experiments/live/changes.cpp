#include "experiments/live/changes.h"

#include <fmt/format.h>

#include <algorithm>

#include <palpate/result.h>
#include "experiments/run/cleaning.h"
#include "toolkit/core/message_text.h"
#include "toolkit/core/physical_ranges.h"

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
  return Error{fmt::format("--changes has {}: {}", shown(part), std::move(what)), kChangeForm, {}, 0};
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
  PALPATE_ASSIGN(ready.report, ready.renderer->prepare(scene, context));
  return ready;
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

}  // namespace palpate::experiments
