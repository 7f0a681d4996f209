#include "experiments/hunt/hunt.h"

#include <fmt/format.h>

#include <filesystem>
#include <utility>

#include <palpate/clock.h>
#include <palpate/result.h>
#include "experiments/driver/suite.h"
#include "experiments/hunt/found.h"
#include "toolkit/core/hash.h"

namespace palpate::experiments {
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
    if (info.role == render::Role::kOurs) all.push_back({info.name, info.name, {}, {}});
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
    const Quarry quarry = afresh ? random_quarry(random, ground) : mutated(from->quarry, random, ground);
    ++quest.trials;
    const Result<HuntScene> scene = make_scene(quarry);
    const NamedOptions named = renderer_of(quest, quarry);
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
        quest.worst[g] = Found{worst.score, number, worst.frame, quarry};
    }
    if (trial->fault.empty()) return;
    ++quest.faulty;
    if (quest.faults.size() < kMostFaults) quest.faults.push_back({trial->fault, number, quarry});
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
