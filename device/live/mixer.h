// Several renderers under one hand. All follow the same HIP in every frame, so that their god objects,
// frictions, filters and caches are right at any moment; one is felt, and the mixer alone knows how another
// takes over: renderers never do.
//
//   steady(A) -> waiting -> steady(B)                 in free space
//   steady(A) -> fading(A->B) -> steady(B)            in contact, by a raised cosine
//   steady(A) -> refused(reason) -> steady(A)
//   fading, waiting -> steady                         a fault or a re-arming: the governor sends zero
//
// The mixer is a renderer itself, as control around a renderer is: a servo, a governor and a device take it
// as they take any. Each renderer has its coupling and filter around it before it comes here; passivity,
// where the scene asks for it, goes around the mixer, for a fade between two passive renderers is not
// strictly passive.
//
// A change of parameters is a switch too: a new renderer on the shared model comes in through offer(), takes
// the place of the old one in its lane by the same rules, and the old one goes out through take_retired(), to
// be destroyed where that may take time.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "device/live/switch_request.h"
#include "device/live/switch_rules.h"
#include "device/live/tracked_renderer.h"
#include "toolkit/core/clock.h"
#include "toolkit/render/renderer.h"

namespace palpate::device {

/// Places for renderers. One of them is kept for a new one that comes in.
inline constexpr std::size_t kMostTracked = 8;
inline constexpr std::size_t kMostLanes = kMostTracked - 1;

enum class MixState : std::uint8_t { kSteady, kWaiting, kFading };

/// What was decided in a frame.
enum class MixDecision : std::uint8_t {
  kNone,
  kWaits,      ///< a request waits; the reason says for what
  kSwapped,    ///< in free space, at once
  kFadeBegun,  ///< in contact
  kFadeDone,
  kRefused,    ///< with a reason
  kQueued,     ///< during a fade: it is taken when the fade is done
  kAborted,    ///< a fade or a wait, by a fault or a re-arming
  kCancelled,  ///< a wait, by another request
  kReplaced,   ///< a renderer that is not felt gave way to a new one in its lane
};
[[nodiscard]] const char* decision_text(MixDecision decision) noexcept;

/// One renderer in one frame.
struct TrackedFrame {
  std::uint8_t lane = 0;
  std::uint32_t generation = 0;  ///< 1 for the first in its lane, more for those that replaced it
  bool present = false;
  bool stepped = false;  ///< in this frame; else `frame` is of an earlier one
  bool ready = false;    ///< it is where the hand is
  Disqualified disqualified = Disqualified::kNo;
  render::Frame frame;       ///< world frame
  std::int64_t step_ns = 0;  ///< 0: not stepped
  /// Itself, for recorders that know what they gave to the mixer; null where there is none. Not to be
  /// stepped.
  render::HapticRenderer* renderer = nullptr;
  double weight = 0.0;  ///< in the force that goes out; all of them together 1, or 0 where none is felt
};

/// What the mixer did in a frame: for recordings, reports and a window.
struct MixedFrame {
  static constexpr std::size_t kNobody = kMostTracked;

  double t_s = 0.0;
  std::array<TrackedFrame, kMostTracked> tracked{};
  std::size_t felt = kNobody;  ///< index in `tracked`: who is felt, or is faded from
  std::size_t to = kNobody;    ///< who is faded to, or waited for
  MixState state = MixState::kSteady;
  bool half_rate = false;  ///< standbys are stepped every second frame
  bool lift_off = false;   ///< the hand should lift off: the request has waited for long
  Vec3 force_n = Vec3::Zero();
  SwitchRequest request{};  ///< taken in this frame
  MixDecision decision = MixDecision::kNone;
  SwitchReason reason = SwitchReason::kNone;
};

/// Owned and used by one thread at a time, the servo's during frames; request(), offer() and take_retired()
/// are for others, as each says. Work of a frame: that of all renderers, and some 300 instructions each. No
/// allocation, lock or log in a frame. Time comes in by step() and, for what frames take, by the clock: with
/// a virtual clock the same calls give the same frames.
class Mixer final : public render::HapticRenderer {
 public:
  /// Options must be right: check(). Keeps references to the clocks. `shown`: by what the frames are timed
  /// that last() shows, where that is another one: on a virtual clock a frame takes no time and nobody is
  /// judged by it, and still somebody may want to know.
  Mixer(const SwitchOptions& options, const Clock& clock) : Mixer(options, clock, clock) {}
  Mixer(const SwitchOptions& options, const Clock& clock, const Clock& shown)
      : options_(options), clock_(clock), shown_(shown) {}
  ~Mixer() override;

  /// Before the first frame: takes a renderer into the next lane, the first of which is felt first. At most
  /// kMostLanes.
  void add(std::unique_ptr<render::HapticRenderer> renderer);
  /// Of all lanes together; for those who do not prepare each by itself.
  [[nodiscard]] Result<render::Decisions> decide(const render::SceneInput& scene,
                                                 const render::PrepareContext& context) const override;
  [[nodiscard]] Result<render::PrepareReport> prepare(const render::SceneInput& scene,
                                                      const render::PrepareContext& context) override;

  /// Everybody begins at a place that is free for all; who was disqualified may be felt again.
  void restart(const Vec3& hip_mm, double t_s) noexcept override;
  /// Everybody goes back to where he himself was last free and is brought up from there: a place that is free
  /// for one may lie under the surface of another. Ends a fade or a wait.
  void let_go(const Vec3& hip_mm) noexcept override;
  /// The mixed force; contact, god object and model of the one that weighs more. A force that is no number
  /// goes out as it is, for the governor to see; from then on there is none until the next let_go() or
  /// restart(), which go on with a renderer that is healthy.
  [[nodiscard]] render::Frame step(const Vec3& hip_mm, double t_s) noexcept override;
  /// Of the one that is felt.
  [[nodiscard]] render::FrameCounters counters() const noexcept override;
  [[nodiscard]] render::Description describe() const override;

  /// Any thread; wait-free. The newest request counts.
  void request(const SwitchRequest& request) noexcept { slot_.post(request); }
  /// One worker thread: hands over a renderer, prepared and restarted at a free place, that is to replace the
  /// one of `lane`. Taken from `renderer` where it answers true; false while the one before has not been
  /// taken: try again later.
  [[nodiscard]] bool offer(std::unique_ptr<render::HapticRenderer>& renderer, std::uint8_t lane) noexcept;
  /// The same thread: one that was replaced, or could not take over; null where there is none.
  [[nodiscard]] std::unique_ptr<render::HapticRenderer> take_retired() noexcept;

  /// The servo's thread, between frames: what the last one did.
  [[nodiscard]] const MixedFrame& last() const noexcept { return mixed_; }
  [[nodiscard]] const SwitchOptions& options() const noexcept { return options_; }
  [[nodiscard]] std::size_t lanes() const noexcept { return lanes_; }

 private:
  static constexpr std::size_t kNobody = MixedFrame::kNobody;
  struct Place {
    TrackedRenderer tracked;
    std::uint8_t lane = 0;
    bool arriving = false;  // is to replace the other one of its lane
    bool leaving = false;   // waits for its place in the outbox
  };

  void step_all(const Vec3& hip_mm, double t_s) noexcept;
  void step_one(std::size_t at, const Vec3& hip_mm, double t_s) noexcept;
  void judge_load() noexcept;
  void watch_pair() noexcept;
  void take_arrival(double t_s) noexcept;
  void settle_arrival() noexcept;
  void retire(std::size_t at) noexcept;
  void hand_out() noexcept;
  void take_request(double t_s) noexcept;
  void ask_for(std::size_t to, double t_s) noexcept;
  void decide_waiting(const Vec3& hip_mm, double t_s) noexcept;
  void decide_by_rules(const Vec3& hip_mm, double t_s) noexcept;
  void advance_fade(double t_s) noexcept;
  void drop_waiting() noexcept;
  void take_over(MixDecision decision) noexcept;
  void refuse(SwitchReason reason) noexcept;
  void say(MixDecision decision, SwitchReason reason) noexcept;
  void abort() noexcept;
  [[nodiscard]] std::size_t in_lane(std::uint8_t lane) const noexcept;
  [[nodiscard]] std::size_t next_lane() const noexcept;
  [[nodiscard]] std::size_t empty_place() const noexcept;
  [[nodiscard]] std::size_t first_healthy() const noexcept;
  [[nodiscard]] render::Frame mix(double t_s) noexcept;
  void show(double t_s) noexcept;

  SwitchOptions options_;
  const Clock& clock_;
  const Clock& shown_;
  std::array<Place, kMostTracked> places_{};
  std::size_t lanes_ = 0;
  std::uint32_t generations_ = 0;
  std::size_t felt_ = kNobody, to_ = kNobody;
  MixState state_ = MixState::kSteady;
  double since_s_ = 0.0;         // of waiting or fading
  double weight_ = 0.0;          // of `to_`
  bool bringing_said_ = false;   // that it waits for the other one to be brought up
  bool waits_for_free_ = false;  // the rule for contact was tried
  bool dead_ = false;            // no force until let_go() or restart()
  bool half_rate_ = false, odd_frame_ = false;
  bool queue_said_ = false;
  bool turned_back_ = false;  // the fade goes back to where it came from
  bool aborted_ = false;      // to be shown in the next frame
  render::FrameTime time_;
  HandSpeed speed_;
  RequestSlot slot_;
  std::atomic<render::HapticRenderer*> inbox_{nullptr};
  std::uint8_t inbox_lane_ = 0;  // the worker's while the inbox is empty, else the servo's
  std::array<std::atomic<render::HapticRenderer*>, kMostTracked> outbox_{};
  MixedFrame mixed_;
};

}  // namespace palpate::device
