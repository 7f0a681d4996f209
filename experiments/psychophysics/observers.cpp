#include "experiments/psychophysics/observers.h"

#include <cmath>

#include <palpate/options.h>
#include <palpate/result.h>
#include "experiments/psychophysics/procedures.h"
#include "toolkit/core/messages.h"
#include "toolkit/core/random.h"

namespace palpate::experiments::psychophysics {
namespace {

// Median and log deviation of answer times, similar to people's.
constexpr double kMedianAnswerS = 1.5, kAnswerSpread = 0.4;
// Distances from the criterion, in deviations, for the steps of confidence.
constexpr double kSureSteps[] = {0.5, 1.0, 2.0};

/// Decision variable in deviations from indifference; above 0: the second answer.
double decision(const ObserverOptions& observer, const Felt& felt, const std::vector<double>& sensed) {
  switch (felt.task) {
    case Task::kAbx: {
      const double a = sensed[0], b = sensed[1], x = sensed[2];
      if (observer.strategy == Strategy::kDifferencing)
        return std::abs(x - a) - std::abs(x - b) + observer.bias;
      // An observer who knows both distributions compares X with their midpoint and the pair by its order.
      const double middle = 0.5 * (felt.strengths[0] + felt.strengths[1]);
      return (b > a ? x - middle : middle - x) + observer.bias;
    }
    case Task::kSameDifferent:
      return std::abs(sensed[0] - sensed[1]) - observer.criterion;
    case Task::kTwoInterval:
      return sensed[1] - sensed[0] + observer.bias;
    case Task::kYesNo:
      break;
  }
  return sensed[0] - 0.5 * observer.dprime + observer.bias;
}

OptionSpec number_spec(const char* key, const char* value, const char* help, double low, double high) {
  OptionSpec one;
  one.key = key, one.kind = OptionKind::kNumber, one.default_value = value, one.help = help;
  one.low = low, one.high = high;
  return one;
}

OptionSpec choice_spec(const char* key, const char* value, const char* help,
                       std::vector<std::string> choices) {
  OptionSpec one;
  one.key = key, one.kind = OptionKind::kChoice, one.default_value = value, one.help = help;
  one.choices = std::move(choices);
  return one;
}

const std::vector<OptionSpec>& simulated_options() {
  static const std::vector<OptionSpec> kSpecs = [] {
    const auto spec = number_spec;
    std::vector<OptionSpec> all = {spec("dprime", "1", "distance of the two renderers", 0.0, kLargestDprime),
                                   spec("jnd", "1", "of the option, in its unit", 1e-12, 1e12),
                                   spec("slope", "1", "exponent of sensation by difference", 0.25, 8.0),
                                   spec("lapse", "0", "share of answers that are thrown", 0.0, 0.5),
                                   spec("bias", "0", "towards the second answer, deviations", -5.0, 5.0),
                                   spec("criterion", "1.5", "difference that is called one", 0.0, 8.0),
                                   spec("catch_dprime", "5", "distance in catch trials", 0.0, 20.0),
                                   spec("missed", "0", "share of trials with a missed deadline", 0.0, 1.0)};
    all.push_back(choice_spec("strategy", "differencing", "how sensations are compared",
                              {"differencing", "independent"}));
    return all;
  }();
  return kSpecs;
}

/// The hand's options; the first of each equals ObserverSpec's default.
std::vector<OptionSpec> hand_options() {
  return {choice_spec("hand", "press", "what the simulated hand does", {"press", "slide", "explore"}),
          number_spec("depth", "4", "of its goal below the surface, mm of the device", 0.1, 50.0)};
}

const std::vector<OptionSpec>& machine_options() {
  static const std::vector<OptionSpec> kSpecs = [] {
    std::vector<OptionSpec> all = hand_options();
    for (const OptionSpec& one :
         {number_spec("stiffness", "0.08", "Weber fraction of stiffness", 1e-3, 1.0),
          number_spec("force", "0.07", "Weber fraction of force", 1e-3, 1.0),
          number_spec("direction", "25.6", "threshold of a force's direction, degrees", 0.1, 180.0),
          number_spec("vibration", "0.2", "Weber fraction of a vibration's amplitude", 1e-3, 1.0),
          number_spec("moved", "0.2", "what a vibrating force moves, kg", 1e-3, 10.0),
          number_spec("lapse", "0", "share of answers that are thrown", 0.0, 0.5),
          number_spec("bias", "0", "towards the second answer, deviations", -5.0, 5.0),
          number_spec("criterion", "1.5", "difference that is called one", 0.0, 8.0),
          choice_spec("strategy", "differencing", "how sensations are compared",
                      {"differencing", "independent"})})
      all.push_back(one);
    return all;
  }();
  return kSpecs;
}

void take_deciding(const Options& options, ObserverOptions& o) {
  o.lapse = options.number("lapse");
  o.bias = options.number("bias");
  o.criterion = options.number("criterion");
  o.strategy = options.text("strategy") == "independent" ? Strategy::kIndependent : Strategy::kDifferencing;
}

void take_hand(const Options& options, ObserverSpec& spec) {
  spec.hand = options.text("hand");
  spec.depth_mm = options.number("depth");
}

void take_machine(const Options& options, ObserverSpec& spec) {
  take_hand(options, spec);
  take_deciding(options, spec.options);
  spec.thresholds.stiffness = options.number("stiffness");
  spec.thresholds.force = options.number("force");
  spec.thresholds.direction_deg = options.number("direction");
  spec.thresholds.vibration = options.number("vibration");
  spec.thresholds.moved_kg = options.number("moved");
}

void take_simulated(const NamedOptions& given, const Options& options, ObserverSpec& spec) {
  ObserverOptions& o = spec.options;
  take_deciding(options, o);
  o.dprime = options.number("dprime");
  o.jnd = options.number("jnd");
  o.slope = options.number("slope");
  o.catch_dprime = options.number("catch_dprime");
  o.missed = options.number("missed");
  spec.has_jnd = given.options.has("jnd");
}

}  // namespace

double dprime_of_difference(const ObserverOptions& observer, Task task, double difference) noexcept {
  if (!(difference > 0.0)) return 0.0;
  return dprime_at_jnd(task) * std::pow(difference / observer.jnd, observer.slope);
}

Result<ObserverSpec> parse_observer(const std::string& text) {
  PALPATE_ASSIGN(const NamedOptions named, parse_named_options(text));
  ObserverSpec spec;
  spec.text = text;
  const std::string owner = "observer " + named.name;
  if (named.name == "simulated") {
    PALPATE_ASSIGN(const Options options, validate(named.options, simulated_options(), owner));
    take_simulated(named, options, spec);
    return spec;
  }
  if (named.name == "machine") {
    spec.kind = ObserverKind::kMachine;
    PALPATE_ASSIGN(const Options options, validate(named.options, machine_options(), owner));
    take_machine(options, spec);
    return spec;
  }
  if (named.name == "person") {
    spec.kind = ObserverKind::kPerson;
    PALPATE_ASSIGN(const Options options, validate(named.options, hand_options(), owner));
    take_hand(options, spec);
    return spec;
  }
  const std::vector<std::string> known = {"simulated", "machine", "person"};
  return Error{
      "there is no observer " + shown(named.name),
      did_you_mean(named.name, known,
                   "take simulated:dprime=1, or simulated:jnd=0.05 where an option is turned; machine; "
                   "or person")};
}

Answer answer_of(const ObserverOptions& observer, const Felt& felt, std::uint64_t seed) {
  Random random(seed_for(seed, felt.trial));
  std::vector<double> sensed;
  for (const double strength : felt.strengths) sensed.push_back(strength + random.normal());
  const double decided = decision(observer, felt, sensed);
  Answer answer;
  answer.choice = decided > 0.0 ? 1 : 0;
  for (const double step : kSureSteps) answer.confidence += std::abs(decided) > step ? 1 : 0;
  if (random.uniform() < observer.lapse) {
    answer.choice = random.uniform() < 0.5 ? 0 : 1;
    answer.confidence = 1;
  }
  answer.seconds = kMedianAnswerS * std::exp(kAnswerSpread * random.normal());
  answer.missed_deadlines = random.uniform() < observer.missed ? 1 : 0;
  return answer;
}

}  // namespace palpate::experiments::psychophysics
