#include "experiments/hunt/hunt.h"

#include <fmt/format.h>

#include <filesystem>
#include <utility>

#include "experiments/hunt/found.h"
#include "experiments/session/run_key.h"
#include "toolkit/core/clock.h"
#include "toolkit/core/hash.h"
#include "toolkit/core/try.h"

namespace palpate::experiments {
namespace {

constexpr const char* kStatePart = "hunt";
/// What is found is kept so often; a stop loses no more.
constexpr double kKeepEveryS = 5.0;
/// Trials that start from nothing.
constexpr double kAfresh = 0.25;
constexpr double kSecondsAMinute = 60.0, kMsPerSecond = 1e3;

/// Ours, where none is named.
Result<std::vector<RendererRequest>> requested(const std::string& text, const render::Registry& registry) {
  if (!text.empty()) return parse_renderers(text, registry);
  std::vector<RendererRequest> all;
  for (const render::RendererInfo& info : registry.all())
    if (info.role == render::Role::kOurs) all.push_back({info.name, info.name, {}, {}});
  return all;
}

/// Options that a hunt may turn: those that are not given.
std::vector<OptionSpec> free_options(const render::RendererInfo& info, const RendererRequest& request) {
  std::vector<OptionSpec> specs;
  for (const OptionSpec& spec : info.options)
    if (!request.options.has(spec.key)) specs.push_back(spec);
  return specs;
}

class Hunt {
 public:
  Hunt(const HuntArguments& arguments, const render::Registry& registry, const OutputFolder& folder,
       std::vector<RendererRequest> renderers)
      : arguments_(arguments), registry_(registry), folder_(folder) {
    for (RendererRequest& request : renderers) {
      options_.push_back(arguments.as_given ? std::vector<OptionSpec>()
                                            : free_options(*registry.find(request.name), request));
      state_.quests.push_back({std::move(request), {}, {}, 0, 0, 0, 0});
    }
  }

  Status run(Context& context) {
    (void)folder_.take_over(kStatePart, kStatePart,
                            [&](const std::string& text) { return from_text(text, state_); });
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
      context.progress.report("hunting", share);
      if (now_s - kept_s > kKeepEveryS) {
        kept_s = now_s;
        PALPATE_TRY(folder_.keep(kStatePart, kStatePart, to_text(state_)));
      }
      one(state_.next_trial++);
    }
  }
  [[nodiscard]] const HuntState& state() const { return state_; }

 private:
  /// Trial `number`, which takes the renderers in turn.
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
  const OutputFolder& folder_;
  std::vector<std::vector<OptionSpec>> options_;  ///< of each quest
  HuntState state_;
};

void print(const HuntState& state, const OutputFolder& folder) {
  for (const Quest& quest : state.quests) {
    fmt::print("{}: {} trials ({} without a model or refused), {} frames at the bound, {} broke a promise\n",
               quest.renderer.label, quest.trials, quest.refused, quest.bound_hits, quest.faulty);
    for (std::size_t g = 0; g < kGoals; ++g) {
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

int hunt(const HuntArguments& arguments, Context& context) {
  const render::Registry registry = all_renderers();
  Result<std::vector<RendererRequest>> renderers = requested(arguments.renderers, registry);
  if (!renderers) return fail(renderers.error(), kExitBadInput, &context.progress);
  const Result<OutputFolder> folder = OutputFolder::open(arguments.out);
  if (!folder) return fail(folder.error(), kExitBadInput, &context.progress);
  RunKey key;
  key.add("hunt").add(arguments.seed).add(std::uint64_t{arguments.as_given});
  for (const RendererRequest& request : *renderers) key.add(request.label).add(key_of(request));
  if (const Status begun = begin_run(*folder, key.word(), context); !begun)
    return fail(begun.error(), kExitFellShort, &context.progress);
  Hunt hunt(arguments, registry, *folder, *std::move(renderers));
  const Status ran = hunt.run(context);
  if (!ran) return fail(ran.error(), kExitFellShort, &context.progress);
  const Result<std::string> json = write_found(*folder, hunt.state(), arguments.seed);
  if (!json) return fail(json.error(), kExitFellShort, &context.progress);
  if (const Status done = folder->complete(); !done)
    return fail(done.error(), kExitFellShort, &context.progress);
  context.progress.clear();
  if (arguments.json)
    fmt::print("{}", *json);
  else
    print(hunt.state(), *folder);
  for (const Quest& quest : hunt.state().quests)
    if (quest.faulty > 0) return kExitFellShort;
  return kExitOk;
}

}  // namespace palpate::experiments
