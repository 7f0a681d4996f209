#include "experiments/hunt/hunt.h"

#include <fmt/format.h>

#include <utility>

#include <palpate/clock.h>
#include <palpate/read_model.h>
#include <palpate/result.h>
#include <palpate/trace.h>
#include "experiments/driver/suite.h"
#include "experiments/hunt/input_json.h"
#include "experiments/hunt/trial.h"
#include "toolkit/core/hash.h"
#include "toolkit/core/messages.h"

namespace palpate::experiments {

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

Result<std::string> write_found(const OutputFolder& folder, const std::vector<Quest>& quests,
                                std::uint64_t seed, const metrics::DocumentHead& head) {
  DocumentJson renderers = DocumentJson::array();
  std::uint64_t trials = 0;
  double spent_s = 0.0;
  for (const Quest& quest : quests) {
    trials += quest.trials;
    spent_s += quest.spent_s;
    DocumentJson worst = DocumentJson::array(), faults = DocumentJson::array();
    const auto write = [&](const std::string& what, const TrialInput& trial_input,
                           DocumentJson row) -> Result<DocumentJson> {
      const std::string name = quest.renderer.label + "-" + what;
      PALPATE_TRY(write_case(folder, name, trial_input, renderer_of(quest, trial_input)));
      row.update({{"case", name + ".toml"}, {"command", command_of(folder, name)}});
      return row;
    };
    for (std::size_t g = 0; g < kGoals; ++g) {
      const auto& found = quest.worst[g];
      if (!found || !(found->score > 0.0)) continue;
      const char* const goal = info_of(static_cast<HuntGoal>(g)).name;
      PALPATE_ASSIGN(
          DocumentJson row,
          write(goal, found->trial_input,
                {{"goal", goal}, {"score", found->score}, {"trial", found->trial}, {"frame", found->frame}}));
      worst.push_back(std::move(row));
    }
    for (const Fault& fault : quest.faults) {
      PALPATE_ASSIGN(DocumentJson row, write(fmt::format("fault-{}", faults.size() + 1), fault.trial_input,
                                             {{"what", fault.what}, {"trial", fault.trial}}));
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
  DocumentJson document = begin_json("palpate-hunt-1", head);
  document.update({{"seed", seed}, {"trials", trials}, {"spent_s", spent_s}, {"renderers", renderers}});
  return document_text(document);
}

namespace {

/// Interval of saving; a stop loses at most this.
constexpr double kKeepEveryS = 5.0;
/// Share of trials from scratch.
constexpr double kAfresh = 0.25;
/// A trial's seconds on one core: 40 of two renderers took 2.8.
constexpr double kTrialS = 0.07;
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
      quests_.push_back({std::move(request), {}, {}, 0, 0, 0, 0, 0.0});
    }
  }

  /// One quest after the other: none looks at what another has found.
  Status run() {
    for (std::size_t q = 0; q < quests_.size(); ++q) {
      const RendererRequest& request = quests_[q].renderer;
      (void)suite_.take(request.label, key_of(request), quests_[q]);
      Case one = untimed(request);
      one.seconds =
          arguments_.trials > 0 ? 1.0 + kTrialS * static_cast<double>(trials_of(q)) : seconds_of_each();
      if (share(q) < 1.0 && suite_.measures(one)) PALPATE_TRY(follow(q));
    }
    return Done{};
  }
  [[nodiscard]] const std::vector<Quest>& quests() const { return quests_; }

 private:
  [[nodiscard]] std::uint64_t trials_of(std::size_t q) const {
    return (arguments_.trials + quests_.size() - 1 - q) / quests_.size();
  }
  [[nodiscard]] double seconds_of_each() const {
    return arguments_.minutes * kSecondsAMinute / static_cast<double>(quests_.size());
  }
  /// Share of its trials or time that the quest has had.
  [[nodiscard]] double share(std::size_t q) const {
    if (arguments_.trials == 0) return quests_[q].spent_s / seconds_of_each();
    return trials_of(q) == 0 ? 1.0
                             : static_cast<double>(quests_[q].trials) / static_cast<double>(trials_of(q));
  }

  Status follow(std::size_t q) {
    Quest& quest = quests_[q];
    const double before_s = quest.spent_s;
    double kept_s = 0.0;
    const Stopwatch watch;
    while (share(q) < 1.0) {
      suite_.progress().report("hunting with " + quest.renderer.label,
                               (static_cast<double>(q) + share(q)) / static_cast<double>(quests_.size()));
      one(q);
      const double now_s = watch.ms() / kMsPerSecond;
      quest.spent_s = before_s + now_s;
      if (now_s - kept_s < kKeepEveryS && share(q) < 1.0) continue;
      kept_s = now_s;
      PALPATE_TRY(suite_.keep(quest.renderer.label, key_of(quest.renderer), quest));
    }
    return Done{};
  }

  /// Runs the next trial of quest `q`. Trials are numbered through all quests.
  void one(std::size_t q) {
    Quest& quest = quests_[q];
    const std::uint64_t number = quest.trials * quests_.size() + q;
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
  std::vector<Quest> quests_;
};

Table quests_table(const std::vector<Quest>& quests) {
  Table table;
  table.title = "Trials";
  table.columns = {"renderer", "trials", "no model, or refused", "frames at the bound", "broke a promise"};
  table.bad_means = "a promise was broken";
  for (const Quest& quest : quests)
    table.rows.push_back({{quest.renderer.label},
                          {format_count(quest.trials)},
                          {format_count(quest.refused)},
                          {format_count(quest.bound_hits)},
                          {format_count(quest.faulty), false, quest.faulty > 0}});
  return table;
}

/// Rows: what was hunted; columns: renderers.
Table worst_table(const std::vector<Quest>& quests) {
  Table table;
  table.title = "The worst that was found";
  table.caption = "In brackets: trial and frame. Each is a case beside the document: RENDERER-GOAL.toml.";
  table.columns = {"goal"};
  for (const Quest& quest : quests) table.columns.push_back(quest.renderer.label);
  for (std::size_t g = 0; g < kGoals; ++g) {
    const GoalInfo& goal = info_of(static_cast<HuntGoal>(g));
    std::vector<Cell> row = {{goal.name}};
    for (const Quest& quest : quests) {
      const std::optional<Found>& found = quest.worst[g];
      row.push_back(found && found->score > 0.0
                        ? Cell{fmt::format("{:.6g} ({}, {})", found->score, found->trial, found->frame)}
                        : Cell{kMissingNumber});
    }
    table.rows.push_back(std::move(row));
    table.notes.push_back(fmt::format("{}: {}.", goal.name, goal.text));
  }
  return table;
}

/// The faults of all, a line each.
std::vector<std::string> faults_of(const std::vector<Quest>& quests) {
  std::vector<std::string> lines;
  for (const Quest& quest : quests)
    for (const Fault& fault : quest.faults)
      lines.push_back(fmt::format("{}: {}; trial {}", quest.renderer.label, fault.what, fault.trial));
  return lines;
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
  if (suite.partial()) return suite.leave();
  const std::vector<Quest>& quests = hunt.quests();
  const metrics::DocumentHead head = new_head(context.command_line);
  SuiteResults results{"hunt.json", {}, {quests_table(quests), worst_table(quests)}, {}, faults_of(quests)};
  PALPATE_ASSIGN(results.json, write_found(suite.folder(), quests, arguments.seed, head));
  Page page = begin_page("The worst that a random search found", head);
  add_known(page, {{}, results.faults, {}});
  page.sections.push_back({"hunt", "Findings", {}, {}, results.tables, {}, {}});
  PALPATE_TRY(suite.publish(results, page, arguments.json));
  for (const Quest& quest : quests)
    if (quest.faulty > 0) return kExitFellShort;
  return kExitOk;
}

}  // namespace palpate::experiments
