#include "device/links/usb_link.h"

#include <libusb.h>
#include <poll.h>
#include <pthread.h>
#include <sched.h>
#include <sys/eventfd.h>
#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <system_error>
#include <thread>
#include <utility>

#include <palpate/clock.h>
#include <palpate/result.h>
#include "device/links/usb_session.h"

namespace palpate::device {
namespace {

// The idle thread checks its flags this often, so a lost wake-up cannot hang it.
constexpr int kUsbLookMs = 100;
// A command takes about 0.1 ms; a device that has not taken two by then takes none.
constexpr double kUsbDrainMs = 200.0, kUsbCancelMs = 500.0;
constexpr double kUsbStopMs = 100.0;
// A bad cable fails single transfers; this many failures in a row mean a lost device.
constexpr int kUsbMostErrors = 16;
constexpr unsigned kUsbControlMs = 1000;
constexpr timespec kUsbLook{0, 100'000};

}  // namespace

struct UsbLink::Io {
  explicit Io(UsbLink& owner) : link(owner) {}

  struct In {
    Io* io = nullptr;
    UsbTransfer transfer;
    std::array<std::uint8_t, kLinkPacketBytes> bytes{};
    bool flying = false;
  };
  struct Command {
    CommandBytes bytes;
    std::uint64_t number = 0;  // submitted up to and including this one
  };
  struct Out {
    Io* io = nullptr;
    UsbTransfer transfer;
    Command command;
    std::int64_t since_ns = 0;
    bool flying = false;
  };

  UsbLink& link;
  UsbSession session;
  std::array<In, kInTransfers> ins;
  Out any, zero_out;  // the second one carries only zero commands
  Command next;       // the newest waiting command; no bytes: none
  std::thread thread;
  std::atomic<bool> stopping{false};
  bool cancelling = false;  // used by the thread
  int errors_in_a_row = 0;

  [[nodiscard]] Status prepare();
  [[nodiscard]] bool start(In& in) noexcept;
  void run() noexcept;
  void handle_events(int wait_ms) noexcept;
  [[nodiscard]] Status prepare(Out& out);
  void take_newest() noexcept;
  void send_newest() noexcept;
  void send(Out& out) noexcept;
  void drain() noexcept;
  [[nodiscard]] bool flying() const noexcept;
  void lost() noexcept { link.gone_.store(true, std::memory_order_release); }
  void arrived(In& in) noexcept;
  void departed(Out& out) noexcept;
  /// Whether to go on after a transfer with this status.
  bool is_recoverable(libusb_transfer_status status) noexcept;
};

Status UsbLink::Io::prepare() {
  for (In& in : ins) {
    in.io = this;
    in.transfer.reset(libusb_alloc_transfer(0));
    if (!in.transfer) return Error{"no memory for USB transfers", "close other programs", link.name_};
    // The kernel serves bulk and interrupt endpoints alike. No timeout.
    libusb_fill_bulk_transfer(
        in.transfer.get(), session.handle(), link.interface_.in, in.bytes.data(),
        static_cast<int>(in.bytes.size()),
        [](libusb_transfer* done) {
          In& ended = *static_cast<In*>(done->user_data);
          ended.io->arrived(ended);
        },
        &in, 0);
  }
  PALPATE_TRY(prepare(any));
  return prepare(zero_out);
}

Status UsbLink::Io::prepare(Out& out) {
  out.io = this;
  out.transfer.reset(libusb_alloc_transfer(0));
  if (!out.transfer) return Error{"no memory for USB transfers", "close other programs", link.name_};
  libusb_fill_bulk_transfer(
      out.transfer.get(), session.handle(), link.interface_.out, out.command.bytes.bytes.data(), 0,
      [](libusb_transfer* done) {
        Out& ended = *static_cast<Out*>(done->user_data);
        ended.io->departed(ended);
      },
      &out, 0);
  return Done{};
}

bool UsbLink::Io::start(In& in) noexcept {
  in.flying = libusb_submit_transfer(in.transfer.get()) == LIBUSB_SUCCESS;
  return in.flying;
}

bool UsbLink::Io::is_recoverable(libusb_transfer_status status) noexcept {
  if (status == LIBUSB_TRANSFER_COMPLETED) {
    errors_in_a_row = 0;
    return true;
  }
  return status != LIBUSB_TRANSFER_NO_DEVICE && ++errors_in_a_row < kUsbMostErrors;
}

void UsbLink::Io::arrived(In& in) noexcept {
  in.flying = false;
  const libusb_transfer_status status = in.transfer->status;
  if (cancelling || status == LIBUSB_TRANSFER_CANCELLED) return;
  if (!is_recoverable(status)) return lost();
  if (status == LIBUSB_TRANSFER_COMPLETED) {
    LinkPacket packet{in.bytes, static_cast<std::size_t>(in.transfer->actual_length)};
    link.counts_.received.fetch_add(1, std::memory_order_relaxed);
    if (packet.size > 0 && !link.packets_.push(packet))
      link.counts_.overrun.fetch_add(1, std::memory_order_relaxed);
  } else {
    link.counts_.in_errors.fetch_add(1, std::memory_order_relaxed);
  }
  if (!start(in)) lost();
}

void UsbLink::Io::departed(Out& out) noexcept {
  out.flying = false;
  link.counts_.done.store(out.command.number, std::memory_order_release);  // the kernel keeps their order
  const libusb_transfer_status status = out.transfer->status;
  if (status == LIBUSB_TRANSFER_CANCELLED) return;
  if (status == LIBUSB_TRANSFER_COMPLETED) {
    const std::int64_t took_ns = monotonic_ns() - out.since_ns;
    link.counts_.sent.fetch_add(1, std::memory_order_relaxed);
    link.counts_.out_ns.fetch_add(took_ns, std::memory_order_relaxed);
    if (took_ns > link.counts_.out_most_ns.load(std::memory_order_relaxed))
      link.counts_.out_most_ns.store(took_ns, std::memory_order_relaxed);
  } else {
    link.counts_.out_errors.fetch_add(1, std::memory_order_relaxed);
  }
  if (!is_recoverable(status)) lost();
}

void UsbLink::Io::take_newest() noexcept {
  const std::uint64_t number = link.counts_.accepted.load(std::memory_order_acquire);
  const bool waited = next.bytes.size > 0;
  if (!link.command_.take(next.bytes)) return;
  next.number = number;
  if (waited) link.counts_.superseded_in_flight.fetch_add(1, std::memory_order_relaxed);
}

/// Submits the newest command if the kernel has none; a zero command if the kernel has no zero.
void UsbLink::Io::send_newest() noexcept {
  if (link.gone_.load(std::memory_order_relaxed)) return;
  take_newest();
  if (next.bytes.size == 0) return;
  if (!any.flying)
    send(any);
  else if (!zero_out.flying && link.lets_go_ != nullptr && link.lets_go_(next.bytes.span()))
    send(zero_out);
}

void UsbLink::Io::send(Out& out) noexcept {
  out.command = std::exchange(next, {});
  out.transfer->length = static_cast<int>(out.command.bytes.size);
  out.since_ns = monotonic_ns();
  const int failed = libusb_submit_transfer(out.transfer.get());
  out.flying = failed == LIBUSB_SUCCESS;
  if (out.flying) return;
  link.counts_.done.store(out.command.number, std::memory_order_release);
  link.counts_.out_errors.fetch_add(1, std::memory_order_relaxed);
  if (!is_recoverable(failed == LIBUSB_ERROR_NO_DEVICE ? LIBUSB_TRANSFER_NO_DEVICE : LIBUSB_TRANSFER_ERROR))
    lost();
}

bool UsbLink::Io::flying() const noexcept {
  for (const In& in : ins)
    if (in.flying) return true;
  return any.flying || zero_out.flying;
}

/// Waits for the files of libusb and of the link, then runs libusb's pending work.
void UsbLink::Io::handle_events(int wait_ms) noexcept {
  std::array<pollfd, UsbSession::kMaxFiles + 1> files{};
  // The file of a lost device is always ready, with nothing to do.
  const bool gone = link.gone_.load(std::memory_order_relaxed);
  const std::size_t count = gone ? 0 : session.files(std::span(files).first(UsbSession::kMaxFiles));
  files[count] = {link.wake_, POLLIN, 0};
  ::poll(files.data(), static_cast<nfds_t>(count + 1), wait_ms);
  std::uint64_t wakes = 0;
  if ((files[count].revents & POLLIN) != 0 && ::read(link.wake_, &wakes, sizeof wakes) < 0) wakes = 0;
  session.handle_events();
}

void UsbLink::Io::run() noexcept {
  if (link.priority_ > 0) {
    sched_param priority{};
    priority.sched_priority = link.priority_;
    ::pthread_setschedparam(::pthread_self(), SCHED_FIFO, &priority);  // ignored where not permitted
  }
  for (In& in : ins)
    if (!start(in)) lost();
  while (!stopping.load(std::memory_order_acquire)) {
    send_newest();
    handle_events(kUsbLookMs);
  }
  drain();
}

/// Ends: sends the submitted commands, then waits for all transfers to complete.
void UsbLink::Io::drain() noexcept {
  const Stopwatch watch;
  do {
    send_newest();
    if (link.command_.empty() && next.bytes.size == 0 && !any.flying && !zero_out.flying) break;
    handle_events(1);
  } while (!link.gone_.load(std::memory_order_relaxed) && watch.ms() < kUsbDrainMs);
  cancelling = true;
  for (In& in : ins)
    if (in.flying) libusb_cancel_transfer(in.transfer.get());
  for (Out* out : {&any, &zero_out})
    if (out->flying) libusb_cancel_transfer(out->transfer.get());
  const Stopwatch cancel_watch;
  while (flying() && cancel_watch.ms() < kUsbCancelMs) handle_events(1);
}

UsbLink::UsbLink(UsbAddress address, const UsbInterface& interface, std::string name,
                 IsZeroCommand is_zero_command, int priority)
    : address_(std::move(address)),
      interface_(interface),
      name_(std::move(name)),
      lets_go_(is_zero_command),
      priority_(priority),
      wake_(::eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC)),
      stop_callback_([this] {
        wait_until_out();
        return std::string();
      }) {}

UsbLink::~UsbLink() {
  stop_callback_.drop();
  close();
  if (wake_ >= 0) ::close(wake_);
}

Status UsbLink::open() {
  close();
  if (wake_ < 0) return Error{"the system gives no file for wake-ups", "close other programs", name_};
  auto io = std::make_unique<Io>(*this);
  PALPATE_TRY(io->session.open(address_, interface_, name_));
  PALPATE_TRY(io->prepare());
  CommandBytes old;
  static_cast<void>(command_.take(old));
  counts_.done.store(counts_.accepted.load());
  packets_.reset();
  taken_ = polled_.size = 0;
  gone_.store(false);
  io_ = std::move(io);
  try {
    io_->thread = std::thread([raw = io_.get()] { raw->run(); });
  } catch (const std::system_error& failed) {
    io_.reset();
    return Error{std::string("no thread for the USB device: ") + failed.what(),
                 "raise the limit of processes (ulimit -u)", name_};
  }
  open_.store(true, std::memory_order_release);
  return Done{};
}

void UsbLink::close() noexcept {
  if (!io_) return;
  open_.store(false, std::memory_order_release);
  io_->stopping.store(true, std::memory_order_release);
  const std::uint64_t one = 1;
  static_cast<void>(::write(wake_, &one, sizeof one) < 0);
  io_->thread.join();
  // libusb still owns an uncompleted transfer: its memory is leaked on purpose.
  if (io_->flying())
    static_cast<void>(io_.release());
  else
    io_.reset();
}

bool UsbLink::submit(std::span<const std::uint8_t> bytes) noexcept {
  if (!open_.load(std::memory_order_acquire) || gone_.load(std::memory_order_acquire)) return false;
  if (bytes.size() > kLinkPacketBytes || !command_.put(bytes)) {
    counts_.refused.fetch_add(1, std::memory_order_relaxed);
    return false;
  }
  counts_.accepted.fetch_add(1, std::memory_order_release);
  const std::uint64_t one = 1;
  static_cast<void>(::write(wake_, &one, sizeof one) < 0);  // full: the thread is awake
  return true;
}

/// A program's exit ends the link's thread, with the commands not yet in the kernel.
void UsbLink::wait_until_out() const noexcept {
  const std::uint64_t until = counts_.accepted.load(std::memory_order_acquire);
  const Stopwatch watch;
  while (open_.load() && !gone_.load() && counts_.done.load(std::memory_order_acquire) < until &&
         watch.ms() < kUsbStopMs)
    ::nanosleep(&kUsbLook, nullptr);
}

Polled UsbLink::poll(std::span<std::uint8_t> into) noexcept {
  if (taken_ == polled_.size) {
    taken_ = 0;
    if (!packets_.pop(polled_)) {
      polled_.size = 0;
      return {0, !open_.load(std::memory_order_acquire) || gone_.load(std::memory_order_acquire)};
    }
  }
  const std::size_t size = std::min(polled_.size - taken_, into.size());
  std::copy_n(polled_.bytes.begin() + static_cast<std::ptrdiff_t>(taken_), size, into.begin());
  taken_ += size;
  return {size, false};
}

Status UsbLink::control(const ControlRequest& request) {
  const auto failed = [&](const char* what) {
    return Error{std::string("a control request failed: ") + what,
                 "unplug the device, plug it in again, and look at its cable and power", name_};
  };
  if (!open_.load() || gone_.load()) return failed("the device is gone");
  // Shared with the callback, which may run after this call timed out.
  struct Pending {
    std::array<std::uint8_t, LIBUSB_CONTROL_SETUP_SIZE> setup{};
    std::atomic<int> status{-1};
  };
  auto pending = std::make_shared<Pending>();
  libusb_transfer* transfer = libusb_alloc_transfer(0);
  if (transfer == nullptr) return failed("no memory");
  libusb_fill_control_setup(pending->setup.data(), request.type, request.request, request.value,
                            request.index, 0);
  auto* keeps = new std::shared_ptr<Pending>(pending);
  libusb_fill_control_transfer(
      transfer, io_->session.handle(), pending->setup.data(),
      [](libusb_transfer* done) {
        auto* kept = static_cast<std::shared_ptr<Pending>*>(done->user_data);
        (*kept)->status.store(static_cast<int>(done->status), std::memory_order_release);
        delete kept;
      },
      keeps, kUsbControlMs);
  transfer->flags = LIBUSB_TRANSFER_FREE_TRANSFER;
  const int started = libusb_submit_transfer(transfer);
  if (started != LIBUSB_SUCCESS) {
    delete keeps;
    libusb_free_transfer(transfer);
    return failed(libusb_error_name(started));
  }
  const Stopwatch watch;
  int status = -1;
  while ((status = pending->status.load(std::memory_order_acquire)) < 0 && watch.ms() < 2.0 * kUsbControlMs)
    ::nanosleep(&kUsbLook, nullptr);
  if (status == LIBUSB_TRANSFER_NO_DEVICE) gone_.store(true);
  if (status == LIBUSB_TRANSFER_COMPLETED) return Done{};
  return failed(status == LIBUSB_TRANSFER_NO_DEVICE ? "the device is gone"
                : status == LIBUSB_TRANSFER_STALL   ? "the device refuses it"
                                                    : "no answer");
}

UsbLinkCounters UsbLink::counters() const noexcept {
  const auto of = [](const std::atomic<std::uint64_t>& count) {
    return count.load(std::memory_order_relaxed);
  };
  constexpr double kUsPerNs = 1e-3;
  UsbLinkCounters all{of(counts_.received),  of(counts_.overrun),
                      of(counts_.sent),      command_.replaced() + of(counts_.superseded_in_flight),
                      of(counts_.refused),   of(counts_.in_errors),
                      of(counts_.out_errors)};
  if (all.sent > 0)
    all.out_mean_us = kUsPerNs * static_cast<double>(counts_.out_ns.load(std::memory_order_relaxed)) /
                      static_cast<double>(all.sent);
  all.out_most_us = kUsPerNs * static_cast<double>(counts_.out_most_ns.load(std::memory_order_relaxed));
  return all;
}

}  // namespace palpate::device
