// The force as a tone: what the samples hold, and that the audio system is given them.
#include "experiments/window/sound.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstring>
#include <string>
#include <thread>
#include <vector>

#include "tests/experiments/program.h"

namespace palpate::experiments {
namespace {

/// Whole waves a second, by upward crossings of zero, and the loudest sample.
struct Heard {
  double hz = 0.0;
  int loudest = 0;
};
Heard heard(const std::vector<std::int16_t>& samples) {
  Heard of;
  int crossings = 0;
  for (std::size_t i = 0; i < samples.size(); ++i) {
    of.loudest = std::max(of.loudest, std::abs(static_cast<int>(samples[i])));
    if (i > 0 && samples[i - 1] < 0 && samples[i] >= 0) ++crossings;
  }
  of.hz = crossings * static_cast<double>(ForceTone::kRateHz) / static_cast<double>(samples.size());
  return of;
}

TEST(ForceTone, IsHigherAndLouderWithTheForceAndSilentWithoutOne) {
  ForceTone tone;
  std::vector<std::int16_t> second(ForceTone::kRateHz);
  tone.fill(second, 0.0);
  EXPECT_EQ(heard(second).loudest, 0);
  Heard last;
  for (const double share : {0.25, 0.5, 0.75, 1.0, 2.0}) {
    tone.fill(second, share);
    tone.fill(second, share);
    const Heard now = heard(second);
    const double reached = std::min(share, 1.0);
    EXPECT_NEAR(now.hz,
                ForceTone::kLowestHz * std::pow(ForceTone::kHighestHz / ForceTone::kLowestHz, reached), 2.0);
    EXPECT_NEAR(now.loudest, 32'767.0 * ForceTone::kLoudest * reached, 20.0);
    EXPECT_GE(now.hz, last.hz);
    last = now;
  }
  tone.fill(second, std::nan(""));
  tone.fill(second, std::nan(""));
  EXPECT_LT(heard(second).loudest, 2) << "what is no number is not heard";
  // A step of the force does not click: from sample to sample no more than the tone itself moves.
  std::vector<std::int16_t> step(2'000);
  ForceTone quiet;
  quiet.fill(step, 1.0);
  constexpr double kSteepest = 2.0 * 3.15 * ForceTone::kHighestHz / ForceTone::kRateHz * ForceTone::kLoudest;
  for (std::size_t i = 1; i < step.size(); ++i)
    ASSERT_LT(std::abs(step[i] - step[i - 1]), 32'767.0 * (kSteepest + 0.01));
}

class PlayedSound : public InFolder {};

TEST_F(PlayedSound, GetsTheNewestForce) {
  // SDL's driver that writes what it is given into a file.
  const Environment driver("SDL_AUDIODRIVER", "disk"), file("SDL_DISKAUDIOFILE", in("heard.raw").c_str());
  std::atomic<float> force_n{1.5f};
  {
    const auto sound = Sound::open(force_n, 3.0);
    if (!sound) GTEST_SKIP() << sound.error().message();
    std::this_thread::sleep_for(std::chrono::milliseconds(500));
  }
  const std::string bytes = file_text(in("heard.raw"));
  std::vector<std::int16_t> samples(bytes.size() / sizeof(std::int16_t));
  std::memcpy(samples.data(), bytes.data(), samples.size() * sizeof(std::int16_t));
  ASSERT_GT(samples.size(), 4'000u);
  const std::vector<std::int16_t> later(samples.begin() + 2'000, samples.end());
  EXPECT_NEAR(heard(later).hz, 2.0 * ForceTone::kLowestHz, 0.06 * 2.0 * ForceTone::kLowestHz)
      << "half of the limit is an octave up";
  EXPECT_NEAR(heard(later).loudest, 0.5 * ForceTone::kLoudest * 32'767.0, 100.0);
}

}  // namespace
}  // namespace palpate::experiments
