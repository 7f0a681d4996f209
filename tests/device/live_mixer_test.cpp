// Several renderers under one hand: who is felt, how another takes over, and what happens where one fails.
#include "device/live/mixer.h"

#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <numbers>
#include <thread>
#include <utility>

#include "device/live/hand_controls.h"
#include "tests/device/live_rig.h"
#include "tests/house/allocation_count.h"

namespace palpate::device {
namespace {

/// Came from above, and has been at rest a millimetre deep for long.
struct Touching : TwoPlanes {
  explicit Touching(SwitchRule rule = SwitchRule::kContactElseWait) : TwoPlanes(bench_options(rule)) {
    come(-1.0, 200, 5);
  }
};

TEST(Mixer, TheFirstIsFeltAndAllFollow) {
  TwoPlanes rig(bench_options());
  rig.begin(1.0);
  const render::Frame frame = rig.rest(-1.0, 10);
  EXPECT_DOUBLE_EQ(frame.force_n.z(), 0.5);
  EXPECT_EQ(rig.a->steps, 10);
  EXPECT_EQ(rig.b->steps, 10) << "the standby is stepped every frame";
  EXPECT_EQ(rig.mixer.last().tracked[0].weight, 1.0);
  EXPECT_EQ(rig.mixer.last().tracked[1].weight, 0.0);
  EXPECT_DOUBLE_EQ(rig.mixer.last().tracked[1].frame.force_n.z(), 0.8);
  EXPECT_EQ(rig.mixer.counters().frames, 10u);
}

TEST(Mixer, InFreeSpaceItSwapsAtOnce) {
  TwoPlanes rig(bench_options());
  rig.begin(5.0);
  rig.rest(5.0, 160);
  rig.ask_at(5.0, 1);
  EXPECT_EQ(rig.mixer.last().decision, MixDecision::kSwapped);
  EXPECT_EQ(rig.felt(), 1);
  EXPECT_DOUBLE_EQ(rig.rest(-1.0, 1).force_n.z(), 0.8);
}

TEST(Mixer, InContactItFadesAndTheForceNeverSteps) {
  Touching rig;
  double last = rig.ask_at(-1.0, 1).force_n.z();
  EXPECT_EQ(rig.mixer.last().decision, MixDecision::kFadeBegun);
  EXPECT_DOUBLE_EQ(last, 0.5) << "the first frame of a fade is all of the old one";
  const double most = 0.3 * std::numbers::pi / (2.0 * 0.15) * 1e-3;
  int frames = 0;
  while (rig.mixer.last().decision != MixDecision::kFadeDone) {
    const double now = rig.step(-1.0).force_n.z();
    ASSERT_LT(++frames, 400);
    EXPECT_LE(std::abs(now - last), most * (1.0 + 1e-9));
    EXPECT_NEAR(rig.mixer.last().tracked[0].weight + rig.mixer.last().tracked[1].weight, 1.0, 1e-15);
    last = now;
  }
  EXPECT_NEAR(frames, 150, 1);
  EXPECT_DOUBLE_EQ(last, 0.8);
  EXPECT_EQ(rig.felt(), 1);
}

/// What it decided in its last frame, and why.
using Decided = std::pair<MixDecision, SwitchReason>;
Decided decided(const TwoPlanes& rig) {
  return {rig.mixer.last().decision, rig.mixer.last().reason};
}

TEST(Mixer, RefusesWithAReason) {
  struct Case {
    SwitchReason reason;
    double second_n_per_mm, second_mm, world_per_device, z_mm, mm_per_frame;
  };
  for (const Case& c : {Case{SwitchReason::kForcesDiffer, 1.2, 0.0, 1.0, -2.0, 0.0},   // 1 and 2.4 N
                        Case{SwitchReason::kContactDiffers, 0.5, 0.3, 1.0, 0.2, 0.0},  // the second alone
                        Case{SwitchReason::kTooFast, 0.8, 0.0, 1.0, -1.0, 0.2},        // 200 mm/s
                        Case{SwitchReason::kNone, 0.8, 0.0, 2.0, -1.0, 0.2}}) {        // the device: 100
    SwitchOptions options = bench_options(SwitchRule::kContactElseRefuse);
    options.world_per_device = c.world_per_device;
    TwoPlanes rig(options, c.second_n_per_mm, c.second_mm);
    rig.begin(1.0);
    rig.rest(-0.5, 100);
    for (int i = 0; i < 200; ++i) rig.step(c.z_mm, c.mm_per_frame * i);
    rig.ask(1);
    rig.step(c.z_mm, c.mm_per_frame * 200);
    const bool fades = c.reason == SwitchReason::kNone;
    EXPECT_EQ(decided(rig), Decided(fades ? MixDecision::kFadeBegun : MixDecision::kRefused, c.reason));
    EXPECT_EQ(rig.mixer.last().state, fades ? MixState::kFading : MixState::kSteady);
  }
}

TEST(Mixer, WaitsByChoiceAsksToLiftOffAndSwapsWhenTheHandHasLeft) {
  TwoPlanes rig(bench_options(), 1.2);
  rig.begin(1.0);
  rig.rest(-2.0, 200);
  rig.ask_at(-2.0, 1);
  EXPECT_EQ(decided(rig), Decided(MixDecision::kWaits, SwitchReason::kForcesDiffer));
  rig.rest(-2.0, 4900);
  EXPECT_FALSE(rig.mixer.last().lift_off);
  rig.rest(-2.0, 200);
  EXPECT_TRUE(rig.mixer.last().lift_off) << "after 5 s the hand is asked to lift off";
  EXPECT_EQ(rig.felt(), 0);
  // It leaves: over 1 mm from the last place of contact, for 150 ms.
  rig.rest(-0.01, 1);
  rig.rest(0.5, 500);
  EXPECT_EQ(rig.felt(), 0) << "half a millimetre is not away";
  rig.rest(1.5, 160);
  EXPECT_EQ(rig.felt(), 1);
}

TEST(Mixer, StudiesWaitForFreeSpaceAlone) {
  Touching rig(SwitchRule::kFreeSpace);
  rig.ask(1);
  rig.rest(-1.0, 300);
  EXPECT_EQ(rig.mixer.last().state, MixState::kWaiting);
  EXPECT_EQ(rig.felt(), 0) << "a fade would have been allowed";
  rig.rest(3.0, 152);
  EXPECT_EQ(rig.felt(), 1);
}

TEST(Mixer, OneRequestIsQueuedDuringAFade) {
  Touching rig;
  rig.ask_at(-1.0, 1);
  rig.ask_at(-1.0, 0);
  EXPECT_EQ(rig.mixer.last().decision, MixDecision::kQueued);
  rig.step(-1.0);
  EXPECT_EQ(rig.mixer.last().decision, MixDecision::kNone) << "said once";
  rig.rest(-1.0, 160);
  EXPECT_EQ(rig.mixer.last().state, MixState::kFading) << "and back";
  rig.rest(-1.0, 160);
  EXPECT_EQ(rig.felt(), 0);
  EXPECT_EQ(rig.mixer.last().state, MixState::kSteady);
}

TEST(Mixer, WhatCannotBeAskedForIsRefused) {
  TwoPlanes rig(bench_options());
  rig.begin(1.0);
  rig.ask_at(1.0, 5);
  EXPECT_EQ(rig.mixer.last().reason, SwitchReason::kNoSuchRenderer);
  rig.ask_at(1.0, 0);
  EXPECT_EQ(rig.mixer.last().reason, SwitchReason::kAlreadyFelt);
  rig.rest(-2.0, 50);
  rig.b->stiffness_n_per_mm = 3.0;
  rig.ask(1);
  rig.rest(-2.0, 3);
  EXPECT_EQ(rig.mixer.last().state, MixState::kWaiting);
  rig.mixer.request({SwitchRequest::Kind::kCancel, SwitchSource::kKey, 0});
  rig.step(-2.0);
  EXPECT_EQ(rig.mixer.last().decision, MixDecision::kCancelled);
  EXPECT_EQ(rig.mixer.last().state, MixState::kSteady);
}

TEST(Mixer, AStandbyThatAnswersNoNumberIsNeverFadedTo) {
  Touching rig;
  rig.b->broken = true;
  EXPECT_DOUBLE_EQ(rig.step(-1.0).force_n.z(), 0.5) << "nobody feels it";
  EXPECT_EQ(rig.mixer.last().tracked[1].disqualified, Disqualified::kNonFinite);
  rig.b->broken = false;
  rig.ask_at(-1.0, 1);
  EXPECT_EQ(rig.mixer.last().reason, SwitchReason::kDisqualified);
  rig.mixer.request({SwitchRequest::Kind::kNext, SwitchSource::kKey, 0});
  rig.step(-1.0);
  EXPECT_EQ(rig.mixer.last().reason, SwitchReason::kNoSuchRenderer) << "the only other one is out";
  rig.begin(1.0);
  rig.step(1.0);
  EXPECT_EQ(rig.mixer.last().tracked[1].disqualified, Disqualified::kNo) << "until the next restart";
}

TEST(Mixer, AFaultInAFadeEndsInZeroAndGoesOnWithWhoIsHealthy) {
  for (const bool old_one : {true, false}) {
    Touching rig;
    rig.ask(1);
    rig.rest(-1.0, 50);
    ASSERT_EQ(rig.mixer.last().state, MixState::kFading);
    (old_one ? rig.a : rig.b)->broken = true;
    EXPECT_FALSE(is_finite(rig.step(-1.0).force_n)) << "the governor must see it";
    EXPECT_EQ(decided(rig), Decided(MixDecision::kAborted, SwitchReason::kFault));
    EXPECT_EQ(rig.rest(-1.0, 5).force_n, Vec3::Zero()) << "not to one, not to the other";
    rig.mixer.release_contact(Vec3(0.0, 0.0, 1.0));
    const render::Frame after = rig.rest(-1.0, 5);
    EXPECT_DOUBLE_EQ(after.force_n.z(), old_one ? 0.8 : 0.5);
    EXPECT_EQ(rig.felt(), old_one ? 1 : 0);
  }
}

TEST(Mixer, LettingGoEndsAFadeWhereItBegan) {
  Touching rig;
  rig.ask(1);
  rig.rest(-1.0, 60);
  rig.mixer.release_contact(Vec3(0.0, 0.0, 1.0));
  rig.step(-1.0);
  EXPECT_EQ(rig.mixer.last().decision, MixDecision::kAborted);
  EXPECT_DOUBLE_EQ(rig.rest(-1.0, 5).force_n.z(), 0.5);
  EXPECT_EQ(rig.a->back_in_time + rig.b->back_in_time, 0);
}

TEST(Mixer, EachIsBroughtUpFromWhereItWasFreeItself) {
  // The second surface stands 2 mm higher: 1 mm is free for the first and not for it.
  TwoPlanes rig(bench_options(), 0.5, 2.0);
  rig.begin(5.0);
  for (int i = 0; i <= 40; ++i) rig.step(5.0 - 0.1 * i);
  rig.rest(1.0, 10);
  rig.mixer.release_contact(Vec3(0.0, 0.0, 1.0));
  EXPECT_DOUBLE_EQ(rig.a->new_points_mm.z(), 1.0);
  EXPECT_GE(rig.b->new_points_mm.z(), 2.0) << "its own last free place";
  rig.rest(1.0, 5);
  EXPECT_TRUE(rig.mixer.last().tracked[1].ready);
}

TEST(Mixer, AStandbyThatIsTooSlowIsDisqualifiedAndOneLateFrameIsNot) {
  TwoPlanes rig(bench_options());
  rig.begin(5.0);
  rig.b->clock = &rig.clock;
  rig.rest(5.0, 10);
  const auto late_frame = [&] {
    rig.b->takes_s = 2e-3;
    rig.t_s = rig.clock.now_s();
    rig.step(5.0);
  };
  late_frame();
  rig.b->takes_s = 0.0;
  rig.t_s = rig.clock.now_s();
  rig.rest(5.0, 100);
  EXPECT_EQ(rig.mixer.last().tracked[1].disqualified, Disqualified::kNo) << "the operating system's";
  for (int i = 0; i < 3; ++i) late_frame();
  EXPECT_EQ(rig.mixer.last().tracked[1].disqualified, Disqualified::kTooSlow);
  const int steps = rig.b->steps;
  rig.t_s = rig.clock.now_s();
  rig.step(5.0);
  EXPECT_EQ(rig.b->steps, steps) << "it is not stepped any more";
}

TEST(Mixer, TooSlowTogetherTheStandbyGoesAtHalfRateAndIsPlacedInFreeSpace) {
  TwoPlanes rig(bench_options());
  rig.begin(5.0);
  rig.a->clock = rig.b->clock = &rig.clock;
  rig.a->takes_s = rig.b->takes_s = 0.35e-3;  // 70 % of a millisecond together
  const auto steps = [&](double z, int frames) {
    for (int i = 0; i < frames; ++i) {
      rig.t_s = std::max(rig.t_s, rig.clock.now_s());
      rig.step(z);
    }
  };
  steps(5.0, 20);
  EXPECT_TRUE(rig.mixer.last().half_rate);
  const int before_a = rig.a->steps, before_b = rig.b->steps;
  steps(5.0, 100);
  EXPECT_EQ(rig.a->steps - before_a, 100);
  EXPECT_EQ(rig.b->steps - before_b, 50);
  // In contact it is refused (here: it waits), however alike the forces are.
  rig.b->stiffness_n_per_mm = 0.5;
  steps(-1.0, 50);
  rig.ask(1);
  steps(-1.0, 1);
  EXPECT_EQ(decided(rig), Decided(MixDecision::kWaits, SwitchReason::kHalfRate));
  const int placed = rig.b->lettings_go;
  steps(4.0, 200);
  EXPECT_EQ(rig.felt(), 1);
  EXPECT_EQ(rig.b->lettings_go, placed + 1) << "brought up in free space";
  rig.a->takes_s = rig.b->takes_s = 0.2e-3;
  steps(4.0, 300);
  EXPECT_FALSE(rig.mixer.last().half_rate) << "and back, when they are quick again";
}

TEST(Mixer, AChangeOfParametersIsASwitch) {
  int destroyed = 0;
  TwoPlanes rig(bench_options());
  rig.a->destroyed = &destroyed;
  rig.come(-1.0, 200);
  std::unique_ptr<render::HapticRenderer> stiffer = std::make_unique<HighPlane>(0.9, 0.0);
  stiffer->restart(Vec3(0.0, 0.0, 1.0), 0.0);
  ASSERT_TRUE(rig.mixer.offer(stiffer, 0));
  EXPECT_EQ(stiffer, nullptr);
  rig.step(-1.0);
  rig.rest(-1.0, 20);
  EXPECT_EQ(rig.mixer.last().state, MixState::kFading);
  EXPECT_EQ(rig.mixer.take_retired(), nullptr) << "the old one is still felt";
  EXPECT_DOUBLE_EQ(rig.rest(-1.0, 160).force_n.z(), 0.9);
  EXPECT_EQ(rig.felt(), 0) << "the lane stays";
  EXPECT_EQ(destroyed, 0) << "nothing is destroyed in a frame";
  {
    const std::unique_ptr<render::HapticRenderer> old = rig.mixer.take_retired();
    EXPECT_EQ(old.get(), rig.a);
  }
  EXPECT_EQ(destroyed, 1);
  EXPECT_EQ(rig.mixer.take_retired(), nullptr);
}

TEST(Mixer, AnArrivalForALaneThatIsNotFeltReplacesItAtOnce) {
  TwoPlanes rig(bench_options());
  rig.come(-1.0, 20);
  std::unique_ptr<render::HapticRenderer> other = std::make_unique<HighPlane>(0.7, 0.0);
  ASSERT_TRUE(rig.mixer.offer(other, 1));
  bool replaced = false;
  for (int i = 0; i < 20; ++i) {
    EXPECT_DOUBLE_EQ(rig.step(-1.0).force_n.z(), 0.5);
    replaced = replaced || rig.mixer.last().decision == MixDecision::kReplaced;
  }
  EXPECT_TRUE(replaced);
  EXPECT_EQ(rig.mixer.take_retired().get(), rig.b);
  rig.ask(1);
  rig.rest(-1.0, 170);
  EXPECT_DOUBLE_EQ(rig.rest(-1.0, 1).force_n.z(), 0.7);
}

TEST(Mixer, AnArrivalThatMayNotTakeOverGoesBack) {
  TwoPlanes rig(bench_options(SwitchRule::kContactElseRefuse));
  rig.come(-2.0, 100);
  std::unique_ptr<render::HapticRenderer> hard = std::make_unique<HighPlane>(1.5, 0.0);
  const render::HapticRenderer* const arrived = hard.get();
  ASSERT_TRUE(rig.mixer.offer(hard, 0));
  bool refused = false;
  for (int i = 0; i < 20; ++i) {
    rig.step(-2.0);
    refused = refused || rig.mixer.last().reason == SwitchReason::kForcesDiffer;
  }
  EXPECT_TRUE(refused);
  EXPECT_EQ(rig.mixer.take_retired().get(), arrived);
  EXPECT_DOUBLE_EQ(rig.rest(-2.0, 1).force_n.z(), 1.0);
}

TEST(Mixer, ArrivalsFromAnotherThreadWhileItRuns) {
  int made = 0, back = 0, destroyed = 0;  // outlive the mixer, which destroys what is left
  TwoPlanes rig(bench_options());
  rig.come(-0.5, 200);  // at rest in contact: else the first would wait for free space, which never comes
  std::atomic<bool> done{false};
  std::thread worker([&] {
    while (made < 20) {
      auto plane = std::make_unique<HighPlane>(0.4 + 0.01 * made, 0.0);
      plane->destroyed = &destroyed;
      std::unique_ptr<render::HapticRenderer> renderer = std::move(plane);
      while (!rig.mixer.offer(renderer, static_cast<std::uint8_t>(made % 2))) {
        if (rig.mixer.take_retired()) ++back;
        std::this_thread::yield();
      }
      ++made;
    }
    done = true;
  });
  int frames = 0;
  while (!done || frames < 1000) {
    const render::Frame frame = rig.step(-0.5);
    ASSERT_TRUE(is_finite(frame.force_n));
    ASSERT_LT(++frames, 100'000'000);
  }
  worker.join();
  // The last arrivals may still wait for the place of what was replaced before them.
  for (int i = 0; i < 3; ++i) {
    rig.rest(-0.5, 1000);
    while (rig.mixer.take_retired()) ++back;
  }
  EXPECT_EQ(back, 20) << "every one that was replaced came back";
  EXPECT_EQ(destroyed, 18) << "of the twenty made, two are there";
}

// Requests, fades, swaps, waits, refusals, arrivals, a fault: everything that a frame can do.
TEST(Mixer, FramesAllocateNothing) {
  TwoPlanes rig(bench_options());
  rig.begin(1.0);
  rig.rest(-1.0, 10);
  std::vector<std::unique_ptr<render::HapticRenderer>> arrivals;
  constexpr int kFrames = 10'000, kEvery = 97, kArrivalEvery = 1009, kFaultAt = 7001;
  for (int i = 0; i < kFrames / kArrivalEvery + 1; ++i)
    arrivals.push_back(std::make_unique<HighPlane>(0.6, 0.0));
  std::size_t next = 0;
  int decisions = 0, fades = 0, swaps = 0;
  std::uint64_t counted = 0;
  for (int i = 0; i < kFrames; ++i) {
    if (i % kArrivalEvery == 0 && next < arrivals.size())
      (void)rig.mixer.offer(arrivals[next++], static_cast<std::uint8_t>(i % 2));
    if (i % kEvery == 0) rig.mixer.request({SwitchRequest::Kind::kNext, SwitchSource::kProgram, 0});
    // In contact for half a second, out of it for as long.
    const double z_mm = i / 500 % 2 == 0 ? -1.0 : 3.0;
    {
      const house::AllocationCount allocations(house::AllocationCount::Threads::kThisOne);
      if (i == kFaultAt) rig.mixer.release_contact(Vec3(0.0, 0.0, 3.0));
      (void)rig.step(z_mm);
      counted += allocations.count();
    }
    if (rig.mixer.last().decision != MixDecision::kNone) ++decisions;
    if (rig.mixer.last().decision == MixDecision::kFadeBegun) ++fades;
    if (rig.mixer.last().decision == MixDecision::kSwapped) ++swaps;
    while (rig.mixer.take_retired()) {
    }
  }
  EXPECT_EQ(counted, 0u);
  EXPECT_GT(decisions, 100);
  EXPECT_GT(fades, 5);
  EXPECT_GT(swaps, 5);
  EXPECT_EQ(next, arrivals.size());
}

TEST(Mixer, WhatIsShownOfFramesMayBeTimedByAnotherClock) {
  VirtualClock judged, shown;
  Mixer mixer(bench_options(), judged, shown);
  auto slow = std::make_unique<HighPlane>(0.5, 0.0);
  slow->clock = &shown;
  slow->takes_s = 0.01;  // ten periods: by the clock that is judged by it takes nothing
  mixer.add(std::move(slow));
  mixer.add(std::make_unique<HighPlane>(0.8, 0.0));
  mixer.restart(Vec3(0.0, 0.0, 1.0), 0.0);
  for (int i = 1; i <= 200; ++i) (void)mixer.step(Vec3(0.0, 0.0, -1.0), 1e-3 * i);
  EXPECT_EQ(mixer.last().tracked[0].step_ns, 10'000'000);
  EXPECT_EQ(mixer.last().tracked[1].step_ns, 0);
  EXPECT_FALSE(mixer.last().half_rate);
  EXPECT_EQ(mixer.last().tracked[1].disqualified, Disqualified::kNo);
}

TEST(Mixer, AHipThatIsNoNumberLeavesAllAsTheyWere) {
  TwoPlanes rig(bench_options());
  rig.begin(1.0);
  rig.rest(-1.0, 10);
  const int steps = rig.a->steps;
  const render::Frame frame =
      rig.mixer.step(Vec3::Constant(std::numeric_limits<double>::quiet_NaN()), rig.t_s + 1e-3);
  EXPECT_EQ(frame.status, render::FrameStatus::kNonFinite);
  EXPECT_EQ(frame.force_n, Vec3::Zero());
  EXPECT_EQ(rig.a->steps, steps);
}

TEST(SwitchButton, APressIsDecidedLaterAndAHeldOneGoesBack) {
  TwoPlanes rig(bench_options());
  SwitchButton button(rig.mixer);
  rig.begin(5.0);
  std::map<int, std::uint8_t> at;  // by the frame
  for (int i = 1; i <= 3000; ++i) {
    rig.step(5.0);
    Tick tick;
    tick.t_s = rig.t_s;
    // A short press at 0.5 s, a long one from 1.5 to 2.3 s.
    tick.state.buttons = (i >= 500 && i < 600) || (i >= 1500 && i < 2300) ? 1u : 0u;
    button.took(tick);
    at[i] = rig.felt();
  }
  EXPECT_EQ(at[690], 0) << "a press moves the hand";
  EXPECT_EQ(at[710], 1);
  EXPECT_EQ(at[2200], 0) << "while it is held";
  EXPECT_EQ(at[2510], 1) << "what was felt before";
}

}  // namespace
}  // namespace palpate::device
