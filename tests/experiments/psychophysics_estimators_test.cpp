// Estimators of psychophysics: against printed numbers, and against observers whose truth is known: bias, and
// how often an interval covers it.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>
#include <map>

#include "experiments/psychophysics/observers.h"
#include "experiments/psychophysics/procedures.h"
#include "experiments/psychophysics/psychometric.h"
#include "tests/toolkit/messages.h"

namespace palpate::experiments::psychophysics {
namespace {

TEST(Distributions, AreThoseOfTables) {
  EXPECT_NEAR(normal_cdf(1.959963984540054), 0.975, 1e-14);
  for (const double p : {1e-9, 0.001, 0.02, 0.3, 0.5, 0.8, 0.99, 0.999999})
    EXPECT_NEAR(normal_cdf(normal_quantile(p)), p, 1e-14 + 1e-12 * p) << p;
  EXPECT_NEAR(normal_quantile(0.75), 0.674489750196082, 1e-13);
  // 12 of 16 by chance (device tests of ABX print 0.038), and sums of a small binomial by hand.
  EXPECT_NEAR(binomial_at_least(16, 12, 0.5), 2517.0 / 65536.0, 1e-13);
  EXPECT_NEAR(binomial_at_most(4, 1, 0.3), 0.6517, 1e-12);
  EXPECT_DOUBLE_EQ(binomial_at_most(4, 4, 0.3), 1.0);
  EXPECT_DOUBLE_EQ(binomial_at_least(4, 0, 0.3), 1.0);
}

TEST(Distributions, ClopperPearsonIsThatOfTables) {
  // None of 10: the upper end is 1 - 0.025^(1/10); 5 of 10: the printed 0.1871 to 0.8129.
  EXPECT_NEAR(clopper_pearson(10, 0).high, 1.0 - std::pow(0.025, 0.1), 1e-12);
  EXPECT_DOUBLE_EQ(clopper_pearson(10, 0).low, 0.0);
  EXPECT_NEAR(clopper_pearson(10, 5).low, 0.187086, 1e-6);
  EXPECT_NEAR(clopper_pearson(10, 5).high, 0.812914, 1e-6);
  EXPECT_DOUBLE_EQ(clopper_pearson(0, 0).high, 1.0);
}

/// Summed over every outcome, so exact: no seed has a say.
TEST(Distributions, ClopperPearsonCoversEverywhere) {
  constexpr std::uint64_t kTrials = 40;
  for (double p = 0.02; p < 0.99; p += 0.024) {
    double covered = 0.0;
    for (std::uint64_t k = 0; k <= kTrials; ++k) {
      const Interval interval = clopper_pearson(kTrials, k);
      const double mass =
          binomial_at_most(kTrials, k, p) - (k > 0 ? binomial_at_most(kTrials, k - 1, p) : 0.0);
      if (interval.low <= p && p <= interval.high) covered += mass;
    }
    EXPECT_GE(covered, 0.95) << p;
    EXPECT_LE(covered, 1.0 + 1e-12) << p;
  }
}

TEST(Detection, ModelsAreThoseOfTheLiterature) {
  // Macmillan and Creelman's tables: ABX at 75 %.
  EXPECT_NEAR(dprime_of_proportion(Task::kAbx, Strategy::kDifferencing, 0.75), 2.02, 0.005);
  EXPECT_NEAR(dprime_of_proportion(Task::kAbx, Strategy::kIndependent, 0.75), 1.79, 0.005);
  EXPECT_NEAR(dprime_of_proportion(Task::kTwoInterval, Strategy::kDifferencing, 0.75), 0.954, 0.001);
  EXPECT_NEAR(dprime_of_proportion(Task::kYesNo, Strategy::kDifferencing, 0.75), 1.349, 0.001);
  // Same-different: the best independent observer needs less than one that takes differences.
  EXPECT_NEAR(dprime_of_proportion(Task::kSameDifferent, Strategy::kIndependent, 0.75), 2.10, 0.005);
  EXPECT_GT(dprime_of_proportion(Task::kSameDifferent, Strategy::kDifferencing, 0.75), 2.10);
  for (const Task task : kTasks)
    for (const Strategy strategy : {Strategy::kDifferencing, Strategy::kIndependent}) {
      EXPECT_NEAR(proportion_correct(task, strategy, 0.0), 0.5, 1e-9) << name_of(task);
      for (const double d : {0.5, 1.5, 3.0})
        EXPECT_NEAR(dprime_of_proportion(task, strategy, proportion_correct(task, strategy, d)), d, 1e-6)
            << name_of(task) << d;
    }
}

TEST(Power, TrialsAreTheComputedOnes) {
  const double shares[] = {0.60, 0.65, 0.70, 0.75};
  const std::uint64_t trials[] = {158, 69, 37, 23};
  for (int i = 0; i < 4; ++i) {
    const auto needed = trials_for_difference(shares[i], 0.8, 0.05).value();
    EXPECT_EQ(needed.first, trials[i]);
    EXPECT_GE(difference_power(needed.first, shares[i], 0.05), 0.8);
    EXPECT_LT(difference_power(needed.first - 1, shares[i], 0.05), 0.8);
    EXPECT_LT(difference_power(needed.safe - 1, shares[i], 0.05), 0.8) << "the number before does not";
    for (std::uint64_t n = needed.safe; n < needed.safe + 200; ++n)
      ASSERT_GE(difference_power(n, shares[i], 0.05), 0.8) << n;
  }
  const std::uint64_t equivalent[] = {158, 68, 39};
  for (int i = 0; i < 3; ++i) {
    const auto needed = trials_for_equivalence(shares[i], 0.8, 0.05).value();
    EXPECT_EQ(needed.first, equivalent[i]);
  }
  EXPECT_FALSE(trials_for_difference(0.5, 0.8, 0.05)) << "nothing is to be found";
  EXPECT_FALSE(trials_for_difference(0.5001, 0.8, 0.05)) << "nobody sits through so many";
}

TEST(Power, TestsKeepTheirErrors) {
  // Exact sums: chance is called a difference, and a share at the bound equivalent, in at most 5 of 100.
  for (const std::uint64_t n : {16u, 40u, 69u, 158u}) {
    EXPECT_LE(difference_power(n, 0.5, 0.05), 0.05) << n;
    double wrongly = 0.0;
    for (std::uint64_t k = 0; k <= n; ++k)
      if (equivalence_p(n, k, 0.65) <= 0.05) wrongly = binomial_at_most(n, k, 0.65);
    EXPECT_LE(wrongly, 0.05) << n;
  }
  const auto bound = shown_bound(68, 0.8, 0.05).value();
  EXPECT_GE(equivalence_power(68, bound, 0.05), 0.8);
  EXPECT_LT(equivalence_power(68, bound - 0.001, 0.05), 0.8) << "the smallest";
  EXPECT_LE(bound, 0.65);
  EXPECT_NEAR(difference_p(16, 12), 0.0384, 1e-4);
}

/// Answers of a simulated observer in a balanced study.
Answers answers_of(Task task, const ObserverOptions& observer, std::uint64_t trials, std::uint64_t seed) {
  Answers answers;
  for (std::uint64_t t = 0; t < trials; ++t) {
    const std::size_t cell = balanced_cell(seed, t, 4);
    const bool second = cell % 2 == 1, turned = cell / 2 == 1;
    Felt felt{task, t, {}};
    const double low = turned ? observer.dprime : 0.0, high = turned ? 0.0 : observer.dprime;
    bool right = second;
    switch (task) {
      case Task::kAbx:
        felt.strengths = {low, high, second ? high : low};
        break;
      case Task::kSameDifferent:
        felt.strengths = {low, second ? high : low};
        break;
      case Task::kTwoInterval:
        felt.strengths =
            second ? std::vector<double>{0.0, observer.dprime} : std::vector<double>{observer.dprime, 0.0};
        break;
      case Task::kYesNo:
        felt.strengths = {second ? observer.dprime : 0.0};
        break;
    }
    const bool said = answer_of(observer, felt, seed).choice == 1;
    (right ? answers.signals : answers.noises) += 1;
    if (said) (right ? answers.hits : answers.false_alarms) += 1;
  }
  return answers;
}

TEST(Observers, AnswerAsOftenRightAsTheirModel) {
  constexpr std::uint64_t kTrials = 40'000, kSeed = 11;
  for (const Task task : kTasks)
    for (const double dprime : {0.0, 1.0, 2.0})
      for (const Strategy strategy : {Strategy::kDifferencing, Strategy::kIndependent}) {
        if (task == Task::kSameDifferent && strategy == Strategy::kIndependent) continue;
        ObserverOptions observer{.dprime = dprime, .strategy = strategy};
        const Answers answers = answers_of(task, observer, kTrials, kSeed);
        EXPECT_EQ(answers.signals, kTrials / 2) << "balanced";
        const double share = static_cast<double>(answers.correct()) / kTrials;
        double model = proportion_correct(task, strategy, dprime);
        if (task == Task::kSameDifferent) {
          const double k = observer.criterion, root = std::sqrt(2.0);
          const double hit = normal_cdf((dprime - k) / root) + normal_cdf((-dprime - k) / root);
          model = 0.5 * (hit + 1.0 - 2.0 * normal_cdf(-k / root));
        }
        // Four deviations of a share of 40,000.
        EXPECT_NEAR(share, model, 4.0 * 0.5 / std::sqrt(double(kTrials))) << name_of(task) << dprime;
      }
}

TEST(Observers, TheSameSeedAnswersTheSame) {
  ObserverOptions observer;
  const Felt felt{Task::kAbx, 17, {0.0, 1.0, 0.0}};
  const Answer a = answer_of(observer, felt, 3), b = answer_of(observer, felt, 3);
  EXPECT_EQ(a.choice, b.choice);
  EXPECT_EQ(a.seconds, b.seconds);
  EXPECT_NE(a.seconds, answer_of(observer, felt, 4).seconds);
}

struct Quality {
  double bias = 0.0, covered = 0.0;
};
Quality quality_of(Task task, const ObserverOptions& observer, std::uint64_t trials, int studies) {
  Quality quality;
  for (int s = 0; s < studies; ++s) {
    const auto found = sensitivity(task, observer.strategy,
                                   answers_of(task, observer, trials, 1000 + static_cast<std::uint64_t>(s)));
    if (!found) continue;
    const double d = observer.dprime;
    quality.bias += (found->dprime.value - d) / studies;
    const Interval& i = found->dprime.interval;
    quality.covered += (i.low <= d && d <= i.high ? 1.0 : 0.0) / studies;
  }
  return quality;
}

/// Of 100 trials: the value is right to 0.15 on average, and the interval covers in at least 90.6 of 100
/// studies (95 less four deviations of 400 studies).
TEST(Sensitivity, IsRightOnAverageAndCovers) {
  constexpr int kStudies = 400;
  constexpr std::uint64_t kTrials = 100;
  for (const Task task : kTasks)
    for (const double dprime : {1.5, 2.5}) {
      ObserverOptions observer{.dprime = dprime};
      const Quality q = quality_of(task, observer, kTrials, kStudies);
      EXPECT_NEAR(q.bias, 0.0, 0.15) << name_of(task) << " " << dprime;
      EXPECT_GE(q.covered, 0.906) << name_of(task) << " " << dprime;
      RecordProperty(std::string(name_of(task)) + std::to_string(dprime), std::to_string(q.covered));
      std::printf("%s d' %.1f: bias %+.3f, covered %.3f\n", name_of(task), dprime, q.bias, q.covered);
    }
}

TEST(Sensitivity, ABiasIsNoInsensitivity) {
  for (const Task task : {Task::kTwoInterval, Task::kYesNo}) {
    ObserverOptions observer{.dprime = 1.5, .bias = 0.7};
    const Quality q = quality_of(task, observer, 200, 200);
    EXPECT_NEAR(q.bias, 0.0, 0.1) << name_of(task);
    EXPECT_GE(q.covered, 0.89) << name_of(task);
    const auto found = sensitivity(task, Strategy::kDifferencing, answers_of(task, observer, 4000, 5));
    EXPECT_NEAR(found.value().criterion.value(), task == Task::kTwoInterval ? -0.7 / std::sqrt(2.0) : -0.7,
                0.1);
  }
}

TEST(Sensitivity, ExtremesAreFinite) {
  for (const Task task : kTasks) {
    const auto all = sensitivity(task, Strategy::kDifferencing, {20, 20, 0, 20}).value();
    EXPECT_TRUE(std::isfinite(all.dprime.value));
    EXPECT_DOUBLE_EQ(std::round(all.dprime.interval.high), kLargestDprime) << "nothing bounds it from above";
    EXPECT_GT(all.dprime.interval.low, 1.0);
    const auto none = sensitivity(task, Strategy::kDifferencing, {10, 20, 10, 20}).value();
    EXPECT_LE(none.dprime.interval.low, 1e-6) << name_of(task);
    EXPECT_FALSE(sensitivity(task, Strategy::kDifferencing, {}));
  }
}

TEST(Psychometric, PassesThreeQuartersAtTheJnd) {
  for (const Task task : {Task::kTwoInterval, Task::kAbx})
    for (const Shape shape : {Shape::kDprime, Shape::kWeibull})
      for (const double slope : {0.7, 1.0, 3.0}) {
        const Psychometric f{task, shape, 0.05, slope, 0.0};
        EXPECT_NEAR(f.proportion(0.05), 0.75, 1e-6);
        EXPECT_DOUBLE_EQ(f.proportion(0.0), 0.5);
        EXPECT_GT(f.proportion(0.1), 0.75);
        EXPECT_LE(f.proportion(5.0), 1.0);
      }
}

/// Whether the observer is right in a trial of two intervals, the second of which is the stronger one or not.
bool is_right(const ObserverOptions& observer, double level, std::uint64_t trial, bool second,
              std::uint64_t seed) {
  const double d = dprime_of_difference(observer, Task::kTwoInterval, level);
  const Felt felt{Task::kTwoInterval, trial,
                  second ? std::vector<double>{0.0, d} : std::vector<double>{d, 0.0}};
  return (answer_of(observer, felt, seed).choice == 1) == second;
}

constexpr int kResamplesHere = 200;
const std::vector<double> kLevels = {0.02, 0.035, 0.05, 0.075, 0.11};

std::vector<LevelAnswers> level_answers(std::uint64_t each, std::uint64_t seed) {
  std::vector<LevelAnswers> all;
  std::uint64_t trial = 0;
  for (const double level : kLevels) {
    LevelAnswers& one = all.emplace_back(LevelAnswers{level, 0, each});
    for (std::uint64_t k = 0; k < each; ++k, ++trial)
      one.correct += is_right({.jnd = 0.05}, level, trial, trial % 2 == 1, seed) ? 1u : 0u;
  }
  return all;
}

/// How good a procedure tells a JND that is known, from a seed: right to 5 % on average, and its interval
/// covers it in at least so large a share of all studies.
template <class Study>
void expect_good(const std::string& what, double jnd, int studies, double least_covered, Study&& study) {
  double log_bias = 0.0, covered = 0.0;
  for (int s = 0; s < studies; ++s) {
    const Estimate found = study(static_cast<std::uint64_t>(s));
    log_bias += std::log(found.value / jnd) / studies;
    covered += (found.interval.low <= jnd && jnd <= found.interval.high ? 1.0 : 0.0) / studies;
  }
  std::printf("%s: bias %+.1f %%, covered %.3f\n", what.c_str(), 100.0 * log_bias, covered);
  EXPECT_NEAR(log_bias, 0.0, 0.05) << what;
  EXPECT_GE(covered, least_covered) << what;
}

/// The method of constant stimuli, 5 x 40 trials: the JND is right to 5 % on average; 95 % intervals cover in
/// at least 87 of 100 studies (95 less four deviations of 120 studies).
TEST(Psychometric, JndIsRightOnAverageAndItsIntervalCovers) {
  for (const Shape shape : {Shape::kDprime, Shape::kWeibull})
    expect_good(std::string("constant levels, ") + name_of(shape), 0.05, 120, 0.87, [&](std::uint64_t s) {
      const auto answers = level_answers(40, 77 + s);
      const auto fit =
          fit_psychometric(answers, {Task::kTwoInterval, shape, 1.0, 1.0, 0.0}, std::nullopt).value();
      return Estimate{fit.function.jnd, bootstrap_jnd(answers, fit, std::nullopt, 5, kResamplesHere)};
    });
}

TEST(Psychometric, TheSameSeedGivesTheSameInterval) {
  const auto answers = level_answers(30, 1);
  const auto fit = fit_psychometric(answers, {}, 1.0).value();
  EXPECT_DOUBLE_EQ(fit.function.slope, 1.0);
  const Interval a = bootstrap_jnd(answers, fit, 1.0, 9, 50), b = bootstrap_jnd(answers, fit, 1.0, 9, 50);
  EXPECT_EQ(a.low, b.low);
  EXPECT_EQ(a.high, b.high);
  EXPECT_FALSE(fit_psychometric({}, {}, 1.0));
}

/// One run of a procedure with an observer of this JND; the level of each trial is given to `see`.
void run_with_observer(Adaptive& procedure, std::uint64_t seed, double jnd = 0.05,
                       const std::function<void(double level, bool correct)>& see = {}) {
  for (std::uint64_t trial = 0; procedure.level(); ++trial) {
    const double level = *procedure.level();
    const bool second = balanced_cell(seed, trial, 2) == 1;
    const bool correct = is_right({.jnd = jnd, .slope = 1.0}, level, trial, second, seed);
    if (see) see(level, correct);
    procedure.answered(correct);
  }
}

/// Levitt's rules converge to 70.7 and 79.4 %, Kaernbach's to what is asked: the share of right answers at
/// the mean reversal of 200 runs is that, to 0.04 (steps of a quarter of an octave leave so much).
TEST(UpDownRules, ConvergeToTheirTarget) {
  for (UpDownOptions options :
       {UpDownOptions{.down = 2}, UpDownOptions{.down = 3}, UpDownOptions{.target = 0.75}}) {
    options.start = 0.2;
    options.factor = 1.4;
    options.reversals = 16;
    options.discarded = 6;
    constexpr int kRuns = 200;
    double log_sum = 0.0;
    for (int r = 0; r < kRuns; ++r) {
      UpDown staircase(options);
      run_with_observer(staircase, 300 + static_cast<std::uint64_t>(r));
      log_sum += std::log(staircase.estimate().value().value) / kRuns;
    }
    const Psychometric truth{Task::kTwoInterval, Shape::kDprime, 0.05, 1.0, 0.0};
    EXPECT_NEAR(truth.proportion(std::exp(log_sum)), target_of(options), 0.04)
        << options.down << " " << options.target;
  }
  EXPECT_NEAR(target_of(UpDownOptions{.down = 2}), 0.7071, 1e-4);
  EXPECT_NEAR(target_of(UpDownOptions{.down = 3}), 0.7937, 1e-4);
}

TEST(UpDownRules, StepAsWritten) {
  UpDown staircase(
      UpDownOptions{.down = 2, .start = 8.0, .factor = 2.0, .halved_after = 100, .reversals = 3});
  const bool answers[] = {true, true, true, false, true, true, true, true};
  const double levels[] = {8, 8, 4, 4, 8, 8, 4, 4};
  for (int i = 0; i < 8; ++i) {
    ASSERT_TRUE(staircase.level()) << i;
    EXPECT_NEAR(*staircase.level(), levels[i], 1e-12) << i;
    staircase.answered(answers[i]);
  }
  EXPECT_EQ(staircase.reversals().size(), 2u);
}

/// 50 trials of the Psi method, from a prior over two decades: right to 5 % on average (400 studies tell it
/// to 1.5 %), wherever in the middle of it the JND lies, and the 95 % of the posterior hold the truth in at
/// least 90.6 of 100 (95 less four deviations of 400 studies).
TEST(PsiMethod, IsRightOnAverageAndCovers) {
  constexpr std::uint64_t kSeedsApart = 1'000'000;
  std::uint64_t seed = 0;
  PsiOptions options;
  options.low = 0.005;
  options.high = 0.5;
  options.trials = 50;
  for (const double jnd : {0.02, 0.1}) {
    seed += kSeedsApart;
    expect_good("Psi, JND " + std::to_string(jnd), jnd, 400, 0.906, [&](std::uint64_t s) {
      Psi psi(options);
      run_with_observer(psi, seed + s, jnd);
      return psi.estimate().value();
    });
  }
}

/// The staircase of the example, its JND by maximum likelihood with slope 1, value and interval from
/// simulated staircases: right to 5 % on average, and the interval covers in at least 87 of 100 studies (95
/// less four deviations of 120).
TEST(UpDownRules, TheirIntervalCovers) {
  const UpDownOptions options{.down = 3, .start = 0.2, .factor = 1.5, .reversals = 14, .discarded = 4};
  expect_good("staircase, 3 down", 0.05, 120, 0.87, [&](std::uint64_t s) {
    UpDown staircase(options);
    std::map<double, LevelAnswers> levels;
    run_with_observer(staircase, 5000 + s, 0.05, [&](double level, bool correct) {
      LevelAnswers& one = levels.try_emplace(level, LevelAnswers{level, 0, 0}).first->second;
      ++one.trials;
      one.correct += correct ? 1u : 0u;
    });
    std::vector<LevelAnswers> all;
    for (const auto& [level, answers] : levels) all.push_back(answers);
    const auto fit = fit_psychometric(all, {}, 1.0).value();
    return bootstrap_procedure([&] { return std::make_unique<UpDown>(options); }, fit, 1.0, s,
                               kResamplesHere);
  });
}

TEST(Order, IsBalancedAndSeeded) {
  for (const std::uint64_t trials : {4u, 13u, 40u}) {
    std::vector<int> counts(4);
    for (std::uint64_t t = 0; t < trials; ++t) ++counts[balanced_cell(7, t, 4)];
    const auto [least, most] = std::minmax_element(counts.begin(), counts.end());
    EXPECT_LE(*most - *least, 1);
  }
  int same = 0;
  for (std::uint64_t t = 0; t < 40; ++t) same += balanced_cell(7, t, 4) == balanced_cell(8, t, 4) ? 1 : 0;
  EXPECT_LT(same, 30);
}

TEST(ObserverSpecs, AreReadAndRefused) {
  const auto good = test::value_of(parse_observer("simulated:dprime=1.5:lapse=0.02"));
  EXPECT_DOUBLE_EQ(good.options.dprime, 1.5);
  EXPECT_FALSE(good.has_jnd);
  const auto machine = test::value_of(parse_observer("machine:hand=slide:stiffness=0.1"));
  EXPECT_EQ(machine.kind, ObserverKind::kMachine);
  EXPECT_EQ(machine.hand, "slide");
  EXPECT_DOUBLE_EQ(machine.thresholds.stiffness, 0.1);
  const auto person = test::value_of(parse_observer("person"));
  EXPECT_EQ(person.kind, ObserverKind::kPerson);
  // What is not named is that of the types.
  const Thresholds usual;
  EXPECT_DOUBLE_EQ(machine.thresholds.force, usual.force);
  EXPECT_DOUBLE_EQ(machine.thresholds.direction_deg, usual.direction_deg);
  EXPECT_DOUBLE_EQ(machine.thresholds.vibration, usual.vibration);
  EXPECT_DOUBLE_EQ(machine.thresholds.moved_kg, usual.moved_kg);
  EXPECT_DOUBLE_EQ(machine.depth_mm, ObserverSpec{}.depth_mm);
  EXPECT_EQ(person.hand, ObserverSpec{}.hand);
  for (const char* bad :
       {"persons", "simulated:dprime=x", "machine:hand=tap", "machine:force=0", "person:dprime=1",
        "simulated:dprime=-1", "simulated:colour=red", "machine:dprime=1", ""})
    EXPECT_FALSE(parse_observer(bad)) << bad;
}

}  // namespace
}  // namespace palpate::experiments::psychophysics
