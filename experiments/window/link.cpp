#include "experiments/window/link.h"

#include <utility>

namespace palpate::experiments {
namespace {

constexpr double kLinkNsPerS = 1e9;

}  // namespace

double SessionLink::since_begin_s() const {
  return static_cast<double>(monotonic_ns() - begun_ns_) / kLinkNsPerS;
}

void SessionLink::show(std::shared_ptr<const ShownScene> scene) {
  const std::scoped_lock lock(mutex_);
  view_.scene = std::move(scene);
  view_.shown_s = since_begin_s();
}

void SessionLink::progress(std::string_view what, double fraction) {
  const std::scoped_lock lock(mutex_);
  view_.phase = what;
  view_.fraction = fraction;
}

void SessionLink::running(std::shared_ptr<const ShownSession> session, SessionActions actions) {
  const std::scoped_lock lock(mutex_);
  view_.session = std::move(session);
  view_.phase.clear();
  actions_ = std::move(actions);
  if (stop_asked() && actions_.stop) actions_.stop();
}

void SessionLink::ended() {
  const std::scoped_lock lock(mutex_);
  actions_ = {};
  view_.session.reset();
}

std::vector<std::string> SessionLink::take_changes() {
  const std::scoped_lock lock(mutex_);
  return std::exchange(changes_, {});
}

void SessionLink::answer(std::string sentence) {
  const std::scoped_lock lock(mutex_);
  view_.answer = std::move(sentence);
}

SessionLink::View SessionLink::view() const {
  const std::scoped_lock lock(mutex_);
  return view_;
}

void SessionLink::request(const device::SwitchRequest& request) {
  const std::scoped_lock lock(mutex_);
  if (actions_.switch_to) actions_.switch_to(request);
}

void SessionLink::rearm() {
  const std::scoped_lock lock(mutex_);
  if (actions_.rearm) actions_.rearm();
}

void SessionLink::mark(const std::string& text) {
  const std::scoped_lock lock(mutex_);
  if (!actions_.mark) {
    view_.answer =
        "Nothing is recorded, so there is nothing to mark: press Record, or start with --record FILE.";
    return;
  }
  const Status marked = actions_.mark(text);
  view_.answer = marked ? "Marked in the recording: " + text : marked.error().message();
}

std::string SessionLink::homing_prompt() const {
  const std::scoped_lock lock(mutex_);
  return actions_.homing_prompt ? actions_.homing_prompt() : std::string();
}

void SessionLink::change(std::string text) {
  const std::scoped_lock lock(mutex_);
  changes_.push_back(std::move(text));
}

void SessionLink::ask_stop() {
  stop_.store(true, std::memory_order_release);
  const std::scoped_lock lock(mutex_);
  if (actions_.stop) actions_.stop();
}

void SessionLink::touchable() {
  const std::scoped_lock lock(mutex_);
  if (view_.touchable_s < 0.0) view_.touchable_s = since_begin_s();
}

void SessionLink::felt() {
  const std::scoped_lock lock(mutex_);
  if (view_.felt_s < 0.0) view_.felt_s = since_begin_s();
}

void SessionLink::begin(std::int64_t from_ns) {
  const std::scoped_lock lock(mutex_);
  view_ = {};
  actions_ = {};
  changes_.clear();
  begun_ns_ = from_ns;
  stop_.store(false, std::memory_order_release);
}

}  // namespace palpate::experiments
