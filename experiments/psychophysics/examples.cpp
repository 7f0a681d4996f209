// Built-in plans: `palpate study abx` runs one, --save-plan writes it for editing.
#include "experiments/psychophysics/plan.h"

namespace palpate::experiments::psychophysics {
namespace {

constexpr const char* kAbxPlan = R"(# Are two renderers told apart? A, B, then X: which of them is X?
title = "cloud against cloud-smooth, ABX"
task = "abx"
scene = "sinusoid:points=10201"
seed = 20260401

[compare]
a = "cloud"
b = "cloud-smooth"

[trials]
count = 80          # a multiple of 4: every order equally often
practice = 4
catch_every = 10    # one in ten that nobody misses
break_every = 40
switch_delay_s = 0.5   # of every switch, sham or not

[power]
detect = 0.65       # a difference heard in 65 % of trials is to be found
equivalence = 0.65  # and its absence shown

[exclusions]        # registered before the first trial
missed_deadlines = 0
clipped_frames = 0
fastest_s = 0.2
slowest_s = 30.0
catch_share = 0.75
)";

constexpr const char* kSameDifferentPlan = R"(# Two touches: the same or different?
title = "cloud against a mesh, same or different"
task = "same-different"
scene = "sinusoid:points=10201"
seed = 20260402

[compare]
a = "cloud"
b = "mesh-godobject"

[trials]
count = 120
practice = 4
)";

constexpr const char* kConstantPlan = R"(# Differences chosen beforehand: the whole psychometric function.
title = "stiffness, five differences"
task = "2ifc"
scene = "sinusoid:points=10201"
seed = 20260403

[option]
renderer = "cloud"
key = "stiffness"
unit = "N/mm"
standard = 0.5
direction = "up"

[trials]
procedure = "fixed"
count = 40                                    # at each difference
levels = [0.02, 0.035, 0.05, 0.075, 0.11]     # N/mm above the standard
practice = 4
catch_every = 20
catch_level = 0.5

[fit]
function = "dprime"
lapse = 0.0
)";

constexpr const char* kStaircasePlan = R"(# One up, two down: the difference that is felt in 71 of 100 trials.
title = "stiffness, staircase"
task = "2ifc"
scene = "sinusoid:points=10201"
seed = 20260404

[option]
renderer = "cloud"
key = "stiffness"
unit = "N/mm"
standard = 0.5

[trials]
procedure = "up-down"
practice = 4

[up_down]
rule = "1up-2down"
start = 0.2
factor = 1.5
reversals = 14
discarded = 4
)";

constexpr const char* kPsiPlan = R"(# The Psi method: each difference is the one that tells most.
title = "stiffness, Psi"
task = "2ifc"
scene = "sinusoid:points=10201"
seed = 20260405

[option]
renderer = "cloud"
key = "stiffness"
unit = "N/mm"
standard = 0.5

[trials]
procedure = "psi"
practice = 4

[psi]
low = 0.005
high = 0.5
trials = 60
)";

}  // namespace

const std::vector<PlanText>& example_plans() {
  static const std::vector<PlanText> kPlans = {{"abx", kAbxPlan},
                                               {"same-different", kSameDifferentPlan},
                                               {"constant", kConstantPlan},
                                               {"staircase", kStaircasePlan},
                                               {"psi", kPsiPlan}};
  return kPlans;
}

}  // namespace palpate::experiments::psychophysics
