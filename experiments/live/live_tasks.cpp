#include "experiments/live/session.h"

#include <fmt/format.h>
#include <sys/resource.h>

#include <algorithm>
#include <filesystem>

#include <palpate/result.h>
#include "experiments/window/link.h"

namespace palpate::experiments {
namespace {

/// Every renderer of a recorded mixer is a RendererTap.
device::RendererTap& tap_of(const device::TrackedFrame& frame) noexcept {
  return static_cast<device::RendererTap&>(*frame.renderer);
}

/// Stores a session's scene changes for one renderer beside its options, under names that no option has; a
/// replay needs them.
device::RecordedRenderer entry_of(const render::HapticRenderer& renderer, const LiveSetting& setting,
                                  bool passivity_apart) {
  device::RecordedRenderer entry{setting.request.label, setting.request.name, {}};
  const Options options = renderer.describe().options;
  entry.options.assign(options.all().begin(), options.all().end());
  if (!setting.request.clean.empty())
    entry.options.emplace_back("scene.clean", fmt::format("{} steps", setting.request.clean.size()));
  if (setting.stiffness_n_per_mm > 0.0)
    entry.options.emplace_back("scene.stiffness", fmt::format("{}", setting.stiffness_n_per_mm));
  if (setting.force_limit_n >= 0.0)
    entry.options.emplace_back("scene.force_limit", fmt::format("{}", setting.force_limit_n));
  if (passivity_apart) entry.options.emplace_back("scene.passivity", "around all");
  return entry;
}

/// Meanings of RecordedTick::decision in a live session.
std::vector<std::string> live_decisions() {
  std::vector<std::string> texts;
  for (int i = 0; i <= static_cast<int>(device::MixDecision::kReplaced); ++i)
    texts.emplace_back(device::decision_text(static_cast<device::MixDecision>(i)));
  texts.front() = "none";
  return texts;
}

}  // namespace

Result<std::unique_ptr<render::HapticRenderer>> LiveRecording::tracked(
    std::unique_ptr<render::HapticRenderer> renderer, const LiveSetting& setting, bool passivity_apart,
    const Clock& clock) {
  device::RecordedRenderer entry = entry_of(*renderer, setting, passivity_apart);
  const auto same = std::count_if(table_.begin(), table_.end(), [&](const device::RecordedRenderer& one) {
    return one.label == entry.label || one.label.starts_with(entry.label + " (");
  });
  if (same > 0) entry.label += fmt::format(" ({})", same + 1);
  const auto index = static_cast<std::uint16_t>(table_.size());
  if (recorder_ != nullptr) {
    PALPATE_TRY(recorder_->add_renderer(entry));
  }
  table_.push_back(std::move(entry));
  return std::unique_ptr<render::HapticRenderer>(
      std::make_unique<device::RendererTap>(std::move(renderer), clock, index));
}

Status LiveRecording::open(const std::string& path, bool replace, bool depth, device::RecordingHeader header,
                           const device::Mixer& mixer) {
  mixer_ = &mixer;
  header.decisions = live_decisions();
  device::RecorderOptions options;
  options.replace = replace;
  options.depth = depth;
  PALPATE_ASSIGN(recorder_, device::Recorder::create(path, header, *this, options));
  for (const device::RecordedRenderer& entry : table_) {
    PALPATE_TRY(recorder_->add_renderer(entry));
  }
  return Done{};
}

void LiveRecording::discard(const std::string& path) {
  recorder_.reset();
  std::error_code code;
  std::filesystem::remove(path, code);
}

void LiveRecording::fill(const device::Tick& tick, device::RecordedTick& out) noexcept {
  static_assert(device::kMaxTracked <= device::RecordedTick::kMaxTracks);
  const device::MixedFrame& mixed = mixer_->last();
  out.hip_mm = tick.hip_mm;
  out.track_count = 0;
  out.active = out.to = device::RecordedTick::kNoTrack;
  out.weight = 0.0;
  out.request = 0;
  // A tick without a mixer step (a fault) has no decision.
  const bool stepped = mixed.t_s == tick.t_s;
  out.decision = stepped ? static_cast<std::uint8_t>(mixed.decision) : 0;
  for (std::size_t i = 0; i < mixed.tracked.size(); ++i) {
    const device::TrackedFrame& one = mixed.tracked[i];
    if (!one.present) continue;
    const auto at = static_cast<std::int8_t>(out.track_count);
    device::RendererTap& tap = tap_of(one);
    device::RecordedTrack& track = out.tracks[out.track_count++];
    track.renderer = tap.index();
    tap.fill(track);
    if (i == mixed.felt) {
      out.active = at;
      out.weight = one.weight;
    }
    if (i == mixed.to) out.to = at;
    using Kind = device::SwitchRequest::Kind;
    const bool asked = mixed.request.kind == Kind::kSelect
                           ? one.lane == mixed.request.lane
                           : mixed.request.kind == Kind::kNext && i == mixed.to;
    if (stepped && asked) out.request = static_cast<std::uint8_t>(at + 1);
  }
}

void LiveRecording::recorded() noexcept {
  for (const device::TrackedFrame& one : mixer_->last().tracked)
    if (one.present) tap_of(one).begin_tick();
}

using RequestKind = device::SwitchRequest::Kind;

namespace {

/// Niceness added to a preparation beside the servo.
constexpr int kPreparingNiceness = 10;

}  // namespace

/// Progress shown in the window, if any; cancelled when the session ends.
struct LiveTasks::Ending final : Progress {
  explicit Ending(const LiveTasks& of) : tasks(of) {}
  void report(std::string_view what, double fraction) override {
    if (tasks.link_ != nullptr) tasks.link_->progress(what, fraction);
  }
  [[nodiscard]] bool cancelled() const override {
    return tasks.ending_.load(std::memory_order_acquire) ||
           (tasks.link_ != nullptr && tasks.link_->stop_asked());
  }
  const LiveTasks& tasks;
};

void LiveTasks::replace_stand_ins(int threads, Made made) {
  workshop_.threads = threads;
  made_ = std::move(made);
  nice_ = true;
  stood_in_.assign(settings_.size(), true);
  for (std::size_t lane = 0; lane < settings_.size(); ++lane) asked_.push_back({0.0, lane, settings_[lane]});
}

/// Lowers the worker's priority for preparing beside the servo; threads it creates inherit this.
void LiveTasks::be_nice() noexcept {
  if (std::exchange(nice_, false)) (void)::setpriority(PRIO_PROCESS, 0, kPreparingNiceness);
}

void SwitchTimer::took(const device::Tick& tick) noexcept {
  if (!begun_) next_s_ = tick.t_s + every_s_;
  begun_ = true;
  if (!(every_s_ > 0.0) || tick.t_s < next_s_) return;
  // Counts from the schedule, not the last switch, so lateness does not add up.
  while (next_s_ <= tick.t_s) next_s_ += every_s_;
  mixer_.request({RequestKind::kNext, device::SwitchSource::kTimer, 0});
}

void LiveTasks::work(double now_s) {
  if (beside_) beside_();
  be_nice();
  now_s_ = now_s;
  while (mixer_.take_retired()) {
  }
  if (pending_ && mixer_.offer(pending_, lane_)) return;
  if (link_ != nullptr) take_asked();
  if (pending_) return;
  const std::optional<LiveChange> taken = due(now_s);
  if (!taken) return;
  const LiveChange& change = *taken;
  Result<std::unique_ptr<render::HapticRenderer>> made = make(change);
  if (link_ != nullptr) link_->progress("", -1.0);
  // Ending the session during a preparation is no error.
  if (!made && Ending(*this).cancelled()) return;
  if (link_ != nullptr && !made) link_->answer(made.error().message());
  if (!made) {
    failures_.push_back(fmt::format("The change of {} at {:g} s was not made: {}",
                                    change.setting.request.label, change.at_s, made.error().message()));
    return;
  }
  (*made)->restart(places_.free_mm, 0.0);
  pending_ = *std::move(made);
  lane_ = static_cast<std::uint8_t>(change.lane);
  (void)mixer_.offer(pending_, lane_);
}

/// Applies changes typed by a person on top of earlier ones.
void LiveTasks::take_asked() {
  for (const std::string& text : link_->take_changes()) {
    const auto parsed = parse_changes("0:" + text, settings_, workshop_.registry);
    if (!parsed) {
      link_->answer(parsed.error().message());
      continue;
    }
    for (const LiveChange& change : *parsed) {
      settings_[change.lane] = change.setting;
      asked_.push_back(change);
    }
  }
}

std::optional<LiveChange> LiveTasks::due(double now_s) {
  if (next_ < changes_.size() && now_s >= changes_[next_].at_s) {
    settings_.resize(std::max(settings_.size(), changes_[next_].lane + 1));
    settings_[changes_[next_].lane] = changes_[next_].setting;
    return changes_[next_++];
  }
  if (asked_.empty()) return std::nullopt;
  const LiveChange first = asked_.front();
  asked_.pop_front();
  return first;
}

Result<std::unique_ptr<render::HapticRenderer>> LiveTasks::make(const LiveChange& change) {
  Ending progress(*this);
  const LiveSetting& setting = change.setting;
  PALPATE_ASSIGN(MadeRenderer made, make_live(workshop_, setting, progress));
  const bool stood_in = change.lane < stood_in_.size() && stood_in_[change.lane];
  if (stood_in) {
    stood_in_[change.lane] = false;
    made_(change.lane, made, now_s_);
  }
  if (link_ != nullptr)
    link_->answer(setting.request.label + (stood_in ? " is there on all points" : " changed"));
  if (places_.recording == nullptr) return std::move(made.renderer);
  return places_.recording->tracked(std::move(made.renderer), setting, workshop_.passivity_apart(), clock_);
}

void LiveTasks::key(char pressed) {
  if (pressed == '\t') mixer_.request({RequestKind::kNext, device::SwitchSource::kKey, 0});
  if (pressed == 'c') mixer_.request({RequestKind::kCancel, device::SwitchSource::kKey, 0});
  if (pressed >= '1' && pressed <= '9')
    mixer_.request(
        {RequestKind::kSelect, device::SwitchSource::kKey, static_cast<std::uint8_t>(pressed - '1')});
}

bool LiveTasks::select(const device::RemoteCommand& command) {
  std::size_t lane = labels_.size();
  if (command.number > 0)
    lane = static_cast<std::size_t>(command.number - 1);
  else
    lane =
        static_cast<std::size_t>(std::find(labels_.begin(), labels_.end(), command.text) - labels_.begin());
  if (lane >= labels_.size()) return false;
  mixer_.request({RequestKind::kSelect, device::SwitchSource::kProgram, static_cast<std::uint8_t>(lane)});
  return true;
}

bool LiveTasks::act(const device::RemoteCommand& command, Assembly& session) {
  using Kind = device::RemoteCommand::Kind;
  switch (command.kind) {
    case Kind::kNone:
      return true;
    case Kind::kNext:
      mixer_.request({RequestKind::kNext, device::SwitchSource::kProgram, 0});
      return true;
    case Kind::kCancel:
      mixer_.request({RequestKind::kCancel, device::SwitchSource::kProgram, 0});
      return true;
    case Kind::kSelect:
      return select(command);
    case Kind::kMark:
      session.mark(command.text);
      return true;
    case Kind::kRearm:
      return session.request_rearm();
  }
  return false;
}

}  // namespace palpate::experiments
