#include "experiments/hunt/hunt.h"

#include <fmt/format.h>

#include <filesystem>
#include <utility>

#include <palpate/clock.h>
#include <palpate/result.h>
#include <palpate/trace.h>
#include <palpate/write_mesh.h>
#include "experiments/driver/suite.h"
#include "experiments/hunt/input_json.h"
#include "experiments/hunt/trial.h"
#include "toolkit/core/hash.h"

namespace palpate::experiments {
namespace {

std::string case_name(const Quest& quest, const std::string& what) {
  return quest.renderer.label + "-" + what;
}
std::string fault_name(std::size_t k) {
  return fmt::format("fault-{}", k + 1);
}

}  // namespace

PALPATE_JSON_MEMBERS(Found, score, trial, frame, trial_input)
PALPATE_JSON_MEMBERS(Fault, what, trial, trial_input)
PALPATE_JSON_MEMBERS(Quest, worst, faults, trials, refused, bound_hits, faulty)

std::string to_text(const HuntState& state) {
  nlohmann::json quests = nlohmann::json::array();
  for (const Quest& quest : state.quests) quests.push_back({quest.renderer.label, quest});
  return to_line(
      nlohmann::json{{"next_trial", state.next_trial}, {"spent_s", state.spent_s}, {"quests", quests}});
}

bool from_text(const std::string& text, HuntState& state) {
  HuntState read = state;
  try {
    const nlohmann::json json = nlohmann::json::parse(text);
    json.at("next_trial").get_to(read.next_trial);
    json.at("spent_s").get_to(read.spent_s);
    const nlohmann::json& quests = json.at("quests");
    if (quests.size() != read.quests.size()) return false;
    for (std::size_t q = 0; q < read.quests.size(); ++q) {
      if (quests.at(q).at(0) != read.quests[q].renderer.label) return false;
      quests.at(q).at(1).get_to(read.quests[q]);
    }
  } catch (const nlohmann::json::exception&) {
    return false;
  }
  state = std::move(read);
  return true;
}

NamedOptions renderer_of(const Quest& quest, const TrialInput& trial_input) {
  NamedOptions named{quest.renderer.name, quest.renderer.options};
  for (const auto& [key, value] : trial_input.options.all()) named.options.set(key, value);
  return named;
}

Status write_case(const OutputFolder& folder, const std::string& name, const TrialInput& trial_input,
                  const NamedOptions& renderer) {
  PALPATE_ASSIGN(const HuntScene scene, make_scene(trial_input));
  PALPATE_ASSIGN(const std::string path, folder.claim(name + ".csv"));
  PALPATE_TRY(trace::write_path_csv(scene.path, path));
  std::string text;
  if (trial_input.hand) {
    PALPATE_ASSIGN(text, hand_scene_toml(trial_input));
  } else {
    PALPATE_ASSIGN(const std::string cloud, folder.claim(name + ".ply"));
    PALPATE_TRY(io::write_cloud_ply(cloud, *scene.input.models[0].cloud));
    text = fmt::format("[[model]]\ncloud = \"{}.ply\"\n", name) + surface_toml(trial_input);
  }
  text += fmt::format("[renderer]\nname = \"{}\"\n", renderer.name) + toml_lines(renderer.options);
  return folder.write(name + ".toml", text);
}

std::string command_of(const OutputFolder& folder, const std::string& name) {
  const std::string at = folder.file(name).string();
  return fmt::format("palpate compare {0}.toml --renderers auto --path {0}.csv --out {0}", at);
}

Result<std::string> write_found(const OutputFolder& folder, const HuntState& state, std::uint64_t seed) {
  DocumentJson renderers = DocumentJson::array();
  for (const Quest& quest : state.quests) {
    DocumentJson worst = DocumentJson::array(), faults = DocumentJson::array();
    const auto write = [&](const std::string& name, const TrialInput& trial_input) -> Result<DocumentJson> {
      PALPATE_TRY(write_case(folder, name, trial_input, renderer_of(quest, trial_input)));
      return DocumentJson{{"case", name + ".toml"}, {"command", command_of(folder, name)}};
    };
    for (std::size_t g = 0; g < kGoals; ++g) {
      const auto& found = quest.worst[g];
      if (!found || !(found->score > 0.0)) continue;
      const GoalInfo& goal = info_of(static_cast<HuntGoal>(g));
      PALPATE_ASSIGN(DocumentJson one, write(case_name(quest, goal.name), found->trial_input));
      DocumentJson row = {
          {"goal", goal.name}, {"score", found->score}, {"trial", found->trial}, {"frame", found->frame}};
      row.update(one);
      worst.push_back(std::move(row));
    }
    for (std::size_t k = 0; k < quest.faults.size(); ++k) {
      PALPATE_ASSIGN(DocumentJson one, write(case_name(quest, fault_name(k)), quest.faults[k].trial_input));
      DocumentJson row = {{"what", quest.faults[k].what}, {"trial", quest.faults[k].trial}};
      row.update(one);
      faults.push_back(std::move(row));
    }
    renderers.push_back({{"label", quest.renderer.label},
                         {"name", quest.renderer.name},
                         {"trials", quest.trials},
                         {"refused", quest.refused},
                         {"bound_hits", quest.bound_hits},
                         {"broken", quest.faulty},
                         {"worst", worst},
                         {"faults", faults}});
  }
  const std::string text = document_text({{"schema", "palpate-hunt-1"},
                                          {"seed", seed},
                                          {"trials", state.next_trial},
                                          {"spent_s", state.spent_s},
                                          {"renderers", renderers}});
  PALPATE_TRY(folder.write("hunt.json", text));
  return text;
}

namespace {

constexpr const char* kStatePart = "hunt";
/// Interval of saving; a stop loses at most this.
constexpr double kKeepEveryS = 5.0;
/// Share of trials from scratch.
constexpr double kAfresh = 0.25;
constexpr double kSecondsAMinute = 60.0, kMsPerSecond = 1e3;

/// The named renderers; ours if none is named.
Result<std::vector<RendererRequest>> requested(const std::string& text, const render::Registry& registry) {
  if (!text.empty()) return parse_renderers(text, registry);
  std::vector<RendererRequest> all;
  for (const render::RendererInfo& info : registry.all())
    if (info.role == render::Role::kOurs && info.geometry != render::Geometry::kImages)
      all.push_back({info.name, info.name, {}, {}});
  return all;
}

/// Options that the hunt may vary: all not given.
std::vector<OptionSpec> free_options(const render::RendererInfo& info, const RendererRequest& request) {
  std::vector<OptionSpec> specs;
  for (const OptionSpec& spec : info.options)
    if (!request.options.has(spec.key)) specs.push_back(spec);
  return specs;
}

class Hunt {
 public:
  Hunt(const HuntArguments& arguments, const render::Registry& registry, const Suite& suite,
       std::vector<RendererRequest> renderers)
      : arguments_(arguments), registry_(registry), suite_(suite) {
    for (RendererRequest& request : renderers) {
      options_.push_back(arguments.as_given ? std::vector<OptionSpec>()
                                            : free_options(*registry.find(request.name), request));
      state_.quests.push_back({std::move(request), {}, {}, 0, 0, 0, 0});
    }
  }

  Status run() {
    (void)suite_.take(kStatePart, kStatePart, state_);
    const double before_s = state_.spent_s;
    const Stopwatch watch;
    double kept_s = 0.0;
    while (true) {
      const double now_s = watch.ms() / kMsPerSecond;
      state_.spent_s = before_s + now_s;
      const double share = arguments_.trials > 0 ? static_cast<double>(state_.next_trial) /
                                                       static_cast<double>(arguments_.trials)
                                                 : state_.spent_s / (arguments_.minutes * kSecondsAMinute);
      if (share >= 1.0) return Done{};
      suite_.progress().report("hunting", share);
      if (now_s - kept_s > kKeepEveryS) {
        kept_s = now_s;
        PALPATE_TRY(suite_.keep(kStatePart, kStatePart, state_));
      }
      one(state_.next_trial++);
    }
  }
  [[nodiscard]] const HuntState& state() const { return state_; }

 private:
  /// Runs trial `number`; renderers take turns.
  void one(std::uint64_t number) {
    const auto q = static_cast<std::size_t>(number % state_.quests.size());
    Quest& quest = state_.quests[q];
    const Ground ground{options_[q],
                        registry_.find(quest.renderer.name)->geometry == render::Geometry::kHeights};
    Random random(arguments_.seed ^ (number + 1) * kGolden64);
    const std::optional<Found>& from = quest.worst[random.below(kGoals)];
    const bool afresh = random.uniform() < kAfresh || !from.has_value();
    const TrialInput trial_input =
        afresh ? random_trial_input(random, ground) : mutated(from->trial_input, random, ground);
    ++quest.trials;
    const Result<HuntScene> scene = make_scene(trial_input);
    const NamedOptions named = renderer_of(quest, trial_input);
    auto renderer = registry_.make(named.name, named.options);
    if (!scene || !renderer) {
      ++quest.refused;
      return;
    }
    const Result<Trial> trial = try_scene(*scene, **renderer);
    if (!trial) {
      ++quest.refused;
      return;
    }
    quest.bound_hits += trial->bound_hits;
    for (std::size_t g = 0; g < kGoals; ++g) {
      const Worst& worst = trial->worst[g];
      if (worst.score > (quest.worst[g] ? quest.worst[g]->score : 0.0))
        quest.worst[g] = Found{worst.score, number, worst.frame, trial_input};
    }
    if (trial->fault.empty()) return;
    ++quest.faulty;
    if (quest.faults.size() < kMostFaults) quest.faults.push_back({trial->fault, number, trial_input});
  }

  const HuntArguments& arguments_;
  const render::Registry& registry_;
  const Suite& suite_;
  std::vector<std::vector<OptionSpec>> options_;  ///< per quest
  HuntState state_;
};

/// A line a renderer and its faults; `whole`: the worst of every goal too.
void print(const HuntState& state, const OutputFolder& folder, bool whole) {
  for (const Quest& quest : state.quests) {
    fmt::print("{}: {} trials ({} without a model or refused), {} frames at the bound, {} broke a promise\n",
               quest.renderer.label, quest.trials, quest.refused, quest.bound_hits, quest.faulty);
    for (std::size_t g = 0; whole && g < kGoals; ++g) {
      const GoalInfo& goal = info_of(static_cast<HuntGoal>(g));
      const auto& found = quest.worst[g];
      if (found && found->score > 0.0)
        fmt::print("  {:<7} {:>12.6g}  {}; trial {}, frame {}\n", goal.name, found->score, goal.text,
                   found->trial, found->frame);
      else
        fmt::print("  {:<7} {:>12}  {}\n", goal.name, "none", goal.text);
    }
    for (const Fault& fault : quest.faults) fmt::print("  BROKEN  {}; trial {}\n", fault.what, fault.trial);
  }
  fmt::print("cases: {}\n", std::filesystem::absolute(folder.path()).string());
}

}  // namespace

Result<int> hunt(const HuntArguments& arguments, Context& context) {
  Suite suite(context);
  const render::Registry registry = all_renderers();
  PALPATE_ASSIGN(std::vector<RendererRequest> renderers, requested(arguments.renderers, registry));
  PALPATE_TRY(suite.open(arguments.out));
  RunKey key;
  key.add("hunt").add(arguments.seed).add(std::uint64_t{arguments.as_given});
  for (const RendererRequest& request : renderers) key.add(request.label).add(key_of(request));
  PALPATE_TRY(suite.begin(key));
  Hunt hunt(arguments, registry, suite, std::move(renderers));
  PALPATE_TRY(hunt.run());
  PALPATE_ASSIGN(const std::string json, write_found(suite.folder(), hunt.state(), arguments.seed));
  PALPATE_TRY(suite.folder().complete());
  suite.progress().clear();
  if (arguments.json)
    fmt::print("{}", json);
  else
    print(hunt.state(), suite.folder(), context.verbose);
  for (const Quest& quest : hunt.state().quests)
    if (quest.faulty > 0) return kExitFellShort;
  return kExitOk;
}

}  // namespace palpate::experiments
