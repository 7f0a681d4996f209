#include "device/links/hid_link.h"

#include <fmt/format.h>
#include <hidapi.h>
#include <pthread.h>
#include <sched.h>
#include <semaphore.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <mutex>
#include <system_error>
#include <thread>
#include <utility>

#include <palpate/device/scheduling.h>
#include "device/links/newest_command.h"

namespace palpate::device {
namespace {

// Above the servo, whose commands it sends, and below the watchdog.
constexpr int kWriterPriority = kServoPriority + 2;
static_assert(kWriterPriority < kWatchdogPriority);

/// hidapi keeps one last error for all threads.
std::mutex& hid_library() {
  static std::mutex mutex;
  return mutex;
}

std::string narrow(const wchar_t* wide) {
  constexpr wchar_t kFirst = 0x20, kLast = 0x7E;  // printable in any terminal encoding
  std::string text;
  for (; wide != nullptr && *wide != 0; ++wide)
    text.push_back(*wide >= kFirst && *wide <= kLast ? static_cast<char>(*wide) : '?');
  return text;
}

std::string ids_text(std::uint16_t vendor, std::uint16_t product) {
  return fmt::format("{:04x}:{:04x}", vendor, product);
}

bool fits(const HidFound& found, const HidAddress& address) {
  const auto is = [](std::uint16_t wanted, std::uint16_t there) { return wanted == 0 || wanted == there; };
  return is(address.vendor, found.vendor) && is(address.product, found.product) &&
         is(address.usage_page, found.usage_page) && is(address.usage, found.usage) &&
         (address.serial.empty() || address.serial == found.serial) &&
         (address.path.empty() || address.path == found.path);
}

std::string wanted_text(const HidAddress& address) {
  std::string text = "HID device";
  if (address.vendor != 0 || address.product != 0) text += " " + ids_text(address.vendor, address.product);
  if (!address.serial.empty()) text += " with serial " + address.serial;
  if (!address.path.empty()) text += " at " + address.path;
  return text;
}

struct HidCloser {
  void operator()(hid_device* device) const noexcept { hid_close(device); }
};
using HidHandle = std::unique_ptr<hid_device, HidCloser>;

HidHandle opened(const std::string& path) {
  const std::lock_guard lock(hid_library());
  return HidHandle(hid_open_path(path.c_str()));
}

Result<HidFound> the_one(const HidAddress& address) {
  const std::vector<HidFound> found = hid_devices(address);
  if (found.empty())
    return Error{"there is no " + wanted_text(address),
                 "connect it; `palpate list devices` shows what is there", address.path};
  if (found.size() > 1) {
    std::string all;
    for (const HidFound& one : found) all += (all.empty() ? "" : "; ") + one.text();
    return Error{"several devices fit " + wanted_text(address) + ": " + all,
                 "name one by its path or serial"};
  }
  if (!found.front().allowed)
    return Error{"you may not open " + found.front().text(),
                 std::string(kUdevRemedy) + " and plug it in again", found.front().path};
  return found.front();
}

}  // namespace

std::string HidFound::text() const {
  std::string all = ids_text(vendor, product);
  if (!product_name.empty()) all += " \"" + product_name + "\"";
  all += " at " + path;
  if (!serial.empty()) all += ", serial " + serial;
  return all;
}

std::vector<HidFound> hid_devices(const HidAddress& address) {
  const std::lock_guard lock(hid_library());
  std::vector<HidFound> all;
  hid_device_info* const first = hid_enumerate(address.vendor, address.product);
  for (const hid_device_info* one = first; one != nullptr; one = one->next) {
    HidFound found{one->path == nullptr ? "" : one->path,
                   one->vendor_id,
                   one->product_id,
                   one->usage_page,
                   one->usage,
                   narrow(one->serial_number),
                   narrow(one->manufacturer_string),
                   narrow(one->product_string),
                   false};
    if (!fits(found, address)) continue;
    found.allowed = ::access(found.path.c_str(), R_OK | W_OK) == 0;
    all.push_back(std::move(found));
  }
  hid_free_enumeration(first);
  std::sort(all.begin(), all.end(), [](const HidFound& a, const HidFound& b) { return a.path < b.path; });
  // hidapi lists a device once for each of its collections.
  all.erase(std::unique(all.begin(), all.end(),
                        [](const HidFound& a, const HidFound& b) { return a.path == b.path; }),
            all.end());
  return all;
}

// Two handles of one device, one per thread: hidapi keeps the last error in the handle.
struct HidLink::State {
  State() { ::sem_init(&work, 0, 0); }
  State(const State&) = delete;
  State& operator=(const State&) = delete;
  ~State() { ::sem_destroy(&work); }

  void write_all() noexcept;

  HidHandle reading, writing;
  NewestCommand newest;
  sem_t work{};
  std::thread writer;
  std::atomic<bool> open{false}, ending{false}, gone{false};
  std::atomic<std::uint64_t> received{0}, written{0};
};

void HidLink::State::write_all() noexcept {
  sched_param priority{};
  priority.sched_priority = kWriterPriority;
  ::pthread_setschedparam(::pthread_self(), SCHED_FIFO, &priority);  // ignored where not permitted
  CommandBytes command;
  for (;;) {
    while (::sem_wait(&work) != 0 && errno == EINTR) {
    }
    const bool last = ending.load(std::memory_order_acquire);
    while (newest.take(command)) {
      if (gone.load(std::memory_order_relaxed)) continue;
      if (hid_write(writing.get(), command.bytes.data(), command.size) < 0)
        gone.store(true, std::memory_order_relaxed);
      else
        written.fetch_add(1, std::memory_order_relaxed);
    }
    if (last) return;
  }
}

HidLink::HidLink(HidAddress address, const HidLinkOptions& options)
    : address_(std::move(address)), options_(options), state_(std::make_unique<State>()) {}

HidLink::~HidLink() {
  close();
}

Status HidLink::open() {
  close();
  const Result<HidFound> found = the_one(address_);
  if (!found) return found.error();
  state_->reading = opened(found->path);
  state_->writing = state_->reading ? opened(found->path) : nullptr;
  if (!state_->writing || hid_set_nonblocking(state_->reading.get(), 1) != 0) {
    state_->reading.reset();
    state_->writing.reset();
    return Error{found->text() + " cannot be opened", "unplug it and plug it in again", found->path};
  }
  path_ = found->path;
  CommandBytes stale;
  state_->newest.take(stale);
  state_->gone = false;
  state_->ending = false;
  state_->received = 0;
  state_->written = 0;
  try {
    state_->writer = std::thread([this] { state_->write_all(); });
  } catch (const std::system_error&) {
    state_->reading.reset();
    state_->writing.reset();
    return Error{"no thread for writing to the device can be started", "close other programs", found->path};
  }
  state_->open.store(true, std::memory_order_release);
  return Done{};
}

void HidLink::close() noexcept {
  if (!state_->open.exchange(false)) return;
  state_->ending.store(true, std::memory_order_release);
  ::sem_post(&state_->work);
  state_->writer.join();
  while (::sem_trywait(&state_->work) == 0) {
  }
  const std::lock_guard lock(hid_library());
  state_->reading.reset();
  state_->writing.reset();
}

bool HidLink::submit(std::span<const std::uint8_t> bytes) noexcept {
  if (!state_->open.load(std::memory_order_acquire) || state_->gone.load(std::memory_order_relaxed))
    return false;
  const std::size_t before = options_.numbered ? 0 : 1;
  std::array<std::uint8_t, CommandBytes::kMost> report{};
  if (bytes.empty() || before + bytes.size() > report.size()) return false;
  std::copy(bytes.begin(), bytes.end(), report.begin() + static_cast<std::ptrdiff_t>(before));
  if (!state_->newest.put(std::span(report).first(before + bytes.size()))) return false;
  ::sem_post(&state_->work);
  return true;
}

Polled HidLink::poll(std::span<std::uint8_t> into) noexcept {
  if (!state_->open.load(std::memory_order_acquire)) return {0, true};
  if (state_->gone.load(std::memory_order_relaxed)) return {0, true};
  const int got = hid_read(state_->reading.get(), into.data(), into.size());
  if (got < 0) {
    state_->gone.store(true, std::memory_order_relaxed);
    return {0, true};
  }
  if (got > 0) state_->received.fetch_add(1, std::memory_order_relaxed);
  return {static_cast<std::size_t>(got), false};
}

LinkCounters HidLink::counters() const noexcept {
  return {state_->received.load(std::memory_order_relaxed), state_->written.load(std::memory_order_relaxed),
          state_->newest.replaced()};
}

}  // namespace palpate::device
