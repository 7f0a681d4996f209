#include "experiments/live/live_tasks.h"

#include <fmt/format.h>
#include <sys/resource.h>

#include <algorithm>

#include <palpate/result.h>
#include "experiments/window/link.h"

namespace palpate::experiments {

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
