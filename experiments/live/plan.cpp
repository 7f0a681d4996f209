// What the arguments of a session ask for, checked before anything is loaded.
#include <fmt/format.h>

#include <algorithm>

#include "device/simulated/arm_models.h"
#include "experiments/live/hand.h"
#include "experiments/live/session.h"
#include "toolkit/core/try.h"
#include "toolkit/core/words.h"

namespace palpate::experiments {
namespace {

Error unknown_word(const char* what, const std::string& word, const std::vector<std::string>& known) {
  return Error{fmt::format("there is no {} '{}'", what, word),
               did_you_mean(word, known, "choose from " + joined(known)),
               {},
               0};
}

Result<device::WorkspaceOptions> workspace_of(const std::string& mapping) {
  constexpr NumberRange kFactors{1e-6, 1e6};
  device::WorkspaceOptions options;
  if (mapping == "1:1") return options;
  if (mapping == "fitted") {
    options.fit = device::WorkspaceFit::kFitted;
    return options;
  }
  const Result<double> factor = read_number(mapping, kFactors);
  if (!factor)
    return Error{fmt::format("--mapping {} is neither 1:1 nor fitted nor a factor: {}", shown(mapping),
                             factor.error().what),
                 "give mm of the scene for a mm of the device, such as 2",
                 {},
                 0};
  options.fit = device::WorkspaceFit::kFactor;
  options.factor = *factor;
  return options;
}

}  // namespace

Result<LivePlan> plan_live(const LiveArguments& arguments, const std::vector<RendererRequest>& renderers,
                           const render::Registry& registry) {
  const std::vector<std::string> rules = {"wait", "refuse", "free"};
  LivePlan plan;
  PALPATE_ASSIGN(plan.rig, device::simulated_rig_of_driver(arguments.device, arguments.grip));
  PALPATE_ASSIGN(plan.workspace, workspace_of(arguments.mapping));
  const auto rule = std::find(rules.begin(), rules.end(), arguments.rule);
  if (rule == rules.end()) return unknown_word("rule", arguments.rule, rules);
  plan.rule = rule == rules.begin()       ? device::SwitchRule::kContactElseWait
              : rule == rules.begin() + 1 ? device::SwitchRule::kContactElseRefuse
                                          : device::SwitchRule::kFreeSpace;
  if (std::find(live_hands().begin(), live_hands().end(), arguments.hand) == live_hands().end())
    return unknown_word("hand", arguments.hand, live_hands());
  if (renderers.size() > device::kMostLanes)
    return Error{fmt::format("--renderers names {} renderers", renderers.size()),
                 fmt::format("one hand takes at most {}", device::kMostLanes),
                 {},
                 0};
  for (const RendererRequest& request : renderers) plan.settings.push_back({request});
  PALPATE_ASSIGN(plan.changes, parse_changes(arguments.changes, plan.settings, registry));
  return plan;
}

}  // namespace palpate::experiments
