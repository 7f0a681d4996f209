// Switches between several renderers under one hand. All follow the same HIP every frame, so their god
// objects, friction, filters and caches are always current; one is felt. Only the mixer knows how another
// takes over.
//
//   steady(A) -> waiting -> steady(B)                 in free space
//   steady(A) -> fading(A->B) -> steady(B)            in contact, by a raised cosine
//   steady(A) -> refused(reason) -> steady(A)
//   fading, waiting -> steady                         a fault or a re-arming: the governor sends zero
//
// The mixer is itself a renderer for servo, governor and device. Each renderer has its coupling and filter
// inside; passivity, if requested, goes around the mixer, because a fade between passive renderers is not
// strictly passive.
//
// A change of parameters is a switch too: a new renderer on the shared model enters by offer(), replaces the
// old one of its lane by the same rules, and the old one leaves by take_retired(), to be destroyed where that
// may take time.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include <palpate/clock.h>
#include <palpate/renderer.h>
#include "device/live/switch_rules.h"
#include "device/live/tracked_renderer.h"
#include "toolkit/render/wrapped_renderer.h"

namespace palpate::device {

/// Slots for renderers; one is reserved for an arriving one.
inline constexpr std::size_t kMaxTracked = 8;
inline constexpr std::size_t kMaxLanes = kMaxTracked - 1;

enum class MixState : std::uint8_t { kSteady, kWaiting, kFading };

/// A frame's decision.
enum class MixDecision : std::uint8_t {
  kNone,
  kWaits,      ///< a request waits; the reason says for what
  kSwapped,    ///< in free space, at once
  kFadeBegun,  ///< in contact
  kFadeDone,
  kRefused,    ///< with a reason
  kQueued,     ///< during a fade: taken when it ends
  kAborted,    ///< a fade or wait, by a fault or re-arming
  kCancelled,  ///< a wait, by another request
  kReplaced,   ///< an unfelt renderer was replaced by a new one in its lane
};
[[nodiscard]] const char* decision_text(MixDecision decision) noexcept;

/// One renderer in one frame.
struct TrackedFrame {
  std::uint8_t lane = 0;
  std::uint32_t generation = 0;  ///< 1 for the first in its lane, rising with each replacement
  bool present = false;
  bool stepped = false;  ///< in this frame; else `frame` is older
  bool ready = false;    ///< it is where the hand is
  Disqualified disqualified = Disqualified::kNo;
  render::Frame frame;       ///< world frame
  std::int64_t step_ns = 0;  ///< 0: not stepped
  /// The renderer, for recorders that know what they gave to the mixer; null if none. They must not step it.
  render::HapticRenderer* renderer = nullptr;
  double weight = 0.0;  ///< in the output force; sum 1, or 0 if none is felt
};

/// A frame's record, for recordings, reports and a window.
struct MixedFrame {
  static constexpr std::size_t kNobody = kMaxTracked;

  double t_s = 0.0;
  std::array<TrackedFrame, kMaxTracked> tracked{};
  std::size_t felt = kNobody;  ///< index in `tracked`: the felt one, or the one faded from
  std::size_t to = kNobody;    ///< the one faded to, or waited for
  MixState state = MixState::kSteady;
  bool half_rate = false;  ///< standbys are stepped every second frame
  bool lift_off = false;   ///< the hand should lift off: the request has waited long
  Vec3 force_n = Vec3::Zero();
  SwitchRequest request{};  ///< taken in this frame
  MixDecision decision = MixDecision::kNone;
  SwitchReason reason = SwitchReason::kNone;
};

/// Owned and used by one thread at a time, the servo's during frames; request(), offer() and take_retired()
/// are for others. Work of a frame: that of all renderers, and some 300 instructions each. No allocation,
/// lock or log. Time comes by step(), and by the clock for frame times: with a virtual clock equal calls give
/// equal frames.
class Mixer final : public render::HapticRenderer {
 public:
  /// Options must satisfy check(). Keeps references to the clocks. `shown`: the clock of the times that
  /// last() shows, if different: on a virtual clock frames take no time, and no renderer is judged by it.
  Mixer(const SwitchOptions& options, const Clock& clock) : Mixer(options, clock, clock) {}
  Mixer(const SwitchOptions& options, const Clock& clock, const Clock& shown)
      : options_(options), clock_(clock), shown_(shown) {}
  ~Mixer() override;

  /// Before the first frame: adds a renderer to the next lane, at most kMaxLanes. The first is felt first.
  void add(std::unique_ptr<render::HapticRenderer> renderer);
  /// For all lanes together, unless they are prepared one by one.
  [[nodiscard]] Result<render::Decisions> decide(const render::SceneInput& scene,
                                                 const render::PrepareContext& context) const override;
  [[nodiscard]] Result<render::PrepareReport> prepare(const render::SceneInput& scene,
                                                      const render::PrepareContext& context) override;

  /// Restarts all at a commonly free place; disqualified ones may be felt again.
  void restart(const Vec3& hip_mm, double t_s) noexcept override;
  /// Each renderer returns to its own last free place and is brought up from there, because a place free for
  /// one may be inside another. Ends a fade or wait.
  void release_contact(const Vec3& hip_mm) noexcept override;
  /// The mixed force, with contact, god object and model of the heavier one. A NaN force is passed to the
  /// governor; afterwards there is none until release_contact() or restart(), which continue with a healthy
  /// renderer.
  [[nodiscard]] render::Frame step(const Vec3& hip_mm, double t_s) noexcept override;
  /// Of the felt renderer.
  [[nodiscard]] render::FrameCounters counters() const noexcept override;
  [[nodiscard]] render::Description describe() const override;

  /// Of a lane's renderer, after the session; zeros for a lane without one.
  [[nodiscard]] render::FrameCounters counters_of(std::uint8_t lane) const noexcept;

  /// Any thread; wait-free. The newest request counts.
  void request(const SwitchRequest& request) noexcept { slot_.post(request); }
  /// One worker thread: hands over a renderer, prepared and restarted at a free place, to replace that of
  /// `lane`. Takes `renderer` if true; false while the last one is not taken: retry later.
  [[nodiscard]] bool offer(std::unique_ptr<render::HapticRenderer>& renderer, std::uint8_t lane) noexcept;
  /// The same thread: a replaced or failed renderer, or null.
  [[nodiscard]] std::unique_ptr<render::HapticRenderer> take_retired() noexcept;

  /// Servo's thread, between frames: the last frame's record.
  [[nodiscard]] const MixedFrame& last() const noexcept { return mixed_; }
  [[nodiscard]] const SwitchOptions& options() const noexcept { return options_; }
  [[nodiscard]] std::size_t lanes() const noexcept { return lanes_; }

 private:
  static constexpr std::size_t kNobody = MixedFrame::kNobody;
  struct Place {
    TrackedRenderer tracked;
    std::uint8_t lane = 0;
    bool arriving = false;  // will replace the other one of its lane
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
  void report(MixDecision decision, SwitchReason reason) noexcept;
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
  std::array<Place, kMaxTracked> places_{};
  std::size_t lanes_ = 0;
  std::uint32_t generations_ = 0;
  std::size_t felt_ = kNobody, to_ = kNobody;
  MixState state_ = MixState::kSteady;
  double since_s_ = 0.0;               // of waiting or fading
  double weight_ = 0.0;                // of `to_`
  bool catching_up_reported_ = false;  // reported that it waits for the bring-up
  bool waits_for_free_ = false;        // the rule for contact was tried
  bool dead_ = false;                  // no force until release_contact() or restart()
  bool half_rate_ = false, odd_frame_ = false;
  bool queue_reported_ = false;
  bool turned_back_ = false;  // the fade is reversed
  bool aborted_ = false;      // to be shown in the next frame
  render::FrameTime time_;
  HandSpeed speed_;
  RequestSlot slot_;
  std::atomic<render::HapticRenderer*> inbox_{nullptr};
  std::uint8_t inbox_lane_ = 0;  // worker's while the inbox is empty, else the servo's
  std::array<std::atomic<render::HapticRenderer*>, kMaxTracked> outbox_{};
  MixedFrame mixed_;
};

}  // namespace palpate::device
