// What goes wrong between a servo and a device over the real hidapi, a pseudo-terminal and UDP sockets. See
// docs/results/hands-and-loops.md for the table.
#include <arpa/inet.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <algorithm>

#include "device/arms/arm_device.h"
#include "device/bridge/bridge_server.h"
#include "device/links/udp_link.h"
#include "tests/device/bridge_rig.h"
#include "tests/device/helpers.h"
#include "tests/device/hid_fake_link.h"
#include "tests/device/link_benches.h"
#include "tests/device/link_faults.h"
#include "tests/device/mock/hidraw_double.h"
#include "tests/device/tty_board.h"
#include "tests/files.h"

namespace palpate::device {
namespace {

using PretendedHid = HidBench<HidrawDouble>;
constexpr const char* kHidName = "hidapi, arm with reports";

/// Polhem's text board: a line for each line.
class TtyBench final : public LinkBench {
 public:
  TtyBench() { plug(); }
  std::string link() const override { return "terminal, arm with text"; }
  Device& device() override { return *device_; }
  void unplug() override {
    board_->unplug();
    held.tell(false);
  }
  void plug() override {
    device_.reset();
    board_ =
        std::make_unique<TtyBoard>([this, line = std::string()](std::span<const std::uint8_t> bytes) mutable {
          return answer(bytes, line);
        });
    ArmDescription arm = find_arm("polhem-v3").value();
    arm.serial_line = board_->path();
    device_ = std::make_unique<ArmDevice>(arm, arm_link(arm), clock_);
  }
  bool counts_packets() const override { return false; }
  std::vector<std::string> program() const override { return {"arm:polhem-v3", "path=" + board_->path()}; }

 private:
  TtyBoard::Bytes answer(std::span<const std::uint8_t> bytes, std::string& line) {
    TtyBoard::Bytes all;
    for (const std::uint8_t byte : bytes) {
      line.push_back(static_cast<char>(byte));
      if (byte != '\n') continue;
      held.tell(!std::exchange(line, {}).starts_with("[0,0,0]"));
      const std::string reply = "[1,0,0,0,0,0,0,0]\n";
      for (const SpoiltReplies::Bytes& one : replies.instead_of({reply.begin(), reply.end()}))
        all.insert(all.end(), one.begin(), one.end());
    }
    return all;
  }

  MonotonicClock clock_;
  std::unique_ptr<TtyBoard> board_;
  std::unique_ptr<ArmDevice> device_;
};

/// Carries datagrams between a host and the far end, by sockets of its own.
class Relay {
 public:
  Relay(const UdpAddress& far, SpoiltReplies& replies) : replies_(replies) {
    own_ = ::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    far_ = ::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    sockaddr_in at = loopback(0);
    EXPECT_EQ(::bind(own_, as_address(at), sizeof at), 0);
    socklen_t size = sizeof at;
    EXPECT_EQ(::getsockname(own_, as_address(at), &size), 0);
    port_ = ntohs(at.sin_port);
    sockaddr_in to =
        loopback(static_cast<std::uint16_t>(std::stoi(far.text().substr(far.text().rfind(':') + 1))));
    EXPECT_EQ(::connect(far_, as_address(to), sizeof to), 0);
    carrier_.emplace([this] { carry(); });
  }
  ~Relay() {
    carrier_.reset();
    ::close(own_);
    ::close(far_);
  }
  [[nodiscard]] std::string where() const { return "127.0.0.1:" + std::to_string(port_); }
  std::atomic<bool> cut{false};  ///< carries nothing

 private:
  static sockaddr_in loopback(std::uint16_t port) {
    sockaddr_in at{};
    at.sin_family = AF_INET;
    at.sin_port = htons(port);
    at.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    return at;
  }
  static sockaddr* as_address(sockaddr_in& at) { return reinterpret_cast<sockaddr*>(&at); }
  void carry() {
    pollfd waits[] = {{own_, POLLIN, 0}, {far_, POLLIN, 0}};
    constexpr int kLookMs = 5;
    ::poll(waits, 2, kLookMs);
    std::uint8_t bytes[kMaxDatagramBytes + 1];
    sockaddr_in from{};
    socklen_t size = sizeof from;
    ssize_t got = ::recvfrom(own_, bytes, sizeof bytes, 0, as_address(from), &size);
    if (got > 0) {
      host_ = from;
      if (!cut) static_cast<void>(::send(far_, bytes, static_cast<std::size_t>(got), 0));
    }
    got = ::recv(far_, bytes, sizeof bytes, 0);
    if (got <= 0 || cut) return;
    for (SpoiltReplies::Bytes& one : replies_.instead_of({bytes, bytes + got}))
      static_cast<void>(::sendto(own_, one.data(), one.size(), 0, as_address(host_), sizeof host_));
  }

  SpoiltReplies& replies_;
  int own_ = -1, far_ = -1;
  std::uint16_t port_ = 0;
  sockaddr_in host_{};
  std::optional<Repeating> carrier_;
};

/// The bridge: a device at a far end in a thread, datagrams over a relay.
class UdpBench final : public LinkBench {
 public:
  explicit UdpBench(bool as_in_a_session)
      : as_in_a_session_(as_in_a_session),
        port_(UdpAddress::of("127.0.0.1:0").value()),
        far_(held_, port_, clock_, far_options()) {
    EXPECT_TRUE(port_.open().ok());
    EXPECT_TRUE(far_.open().ok());
    relay_.emplace(port_.address(), replies);
    ticker_.emplace([this] {
      std::this_thread::sleep_for(kBoardPeriod);
      far_.tick();
      held.tell(held_.held_n != Vec3::Zero());
    });
    BridgeOptions options{.name = "bridge:relay", .session = 0x1234'5678'9ABC'DEF0};
    if (!as_in_a_session_) options.max_age_s = kPatientS;
    device_ = std::make_unique<BridgeDevice>(
        std::make_unique<UdpLink>(UdpAddress::of(relay_->where()).value()), clock_, options);
  }
  std::string link() const override { return "UDP bridge"; }
  Device& device() override { return *device_; }
  void unplug() override { relay_->cut = true; }
  void plug() override { relay_->cut = false; }
  bool counts_packets() const override { return true; }
  std::vector<std::string> program() const override {
    std::vector<std::string> words = {"bridge:" + relay_->where()};
    if (!as_in_a_session_) words.emplace_back("most-age-ms=500");
    return words;
  }

 private:
  static constexpr double kPatientS = 0.5;
  [[nodiscard]] BridgeServerOptions far_options() const {
    BridgeServerOptions options;
    if (as_in_a_session_) return options;
    options.watchdog_s = options.max_age_s = kPatientS;
    options.late_zero_s = options.latch_late_s = options.silence_s = 30.0;
    return options;
  }

  bool as_in_a_session_;
  MonotonicClock clock_;
  HeldDevice held_{clock_};
  UdpPort port_;
  BridgeServer far_;
  std::optional<Relay> relay_;
  std::optional<Repeating> ticker_;
  std::unique_ptr<BridgeDevice> device_;
};

class HidLinkFaults : public testing::TestWithParam<int> {
 protected:
  static LinkWrong wrong() { return static_cast<LinkWrong>(GetParam()); }
};

TEST_P(HidLinkFaults, OverHidapiEndInZero) {
  PretendedHid bench(kHidName);
  EXPECT_EQ(violations_of(bench, wrong()), "");
}
TEST_P(HidLinkFaults, OverATerminalEndInZero) {
  TtyBench bench;
  EXPECT_EQ(violations_of(bench, wrong()), "");
}
TEST_P(HidLinkFaults, OverUdpEndInZero) {
  UdpBench bench(false);
  EXPECT_EQ(violations_of(bench, wrong()), "");
}
INSTANTIATE_TEST_SUITE_P(Each, HidLinkFaults, testing::Range(0, kLinkWrongs));

// A program that is killed may leave half a line, and who opens the line again throws away what is queued.
TEST(TextArm, HalfACommandDoesNotSpoilTheGuardsZero) {
  std::string last;
  std::mutex mutex;
  TtyBoard board([&, held = std::string()](std::span<const std::uint8_t> bytes) mutable {
    const std::lock_guard lock(mutex);
    for (const std::uint8_t byte : bytes) {
      held.push_back(static_cast<char>(byte));
      if (byte == '\n') last = std::exchange(held, {});
    }
    return TtyBoard::Bytes{};
  });
  const MonotonicClock clock;
  const auto made = value_of(driver_of(&register_arm_driver, "arm:polhem-v3")
                                 .make({"arm:polhem-v3", {}, {{"path", board.path()}}}, clock));
  const int line = ::open(board.path().c_str(), O_WRONLY | O_NOCTTY | O_CLOEXEC);
  ASSERT_EQ(::write(line, "[900,0,", 7), 7);
  while (board.received().size() < 7) ::usleep(1000);
  ASSERT_TRUE(made.zero());
  ::close(line);
  constexpr int kPatienceMs = 2000;
  const auto is_zero = [&] {
    const std::lock_guard lock(mutex);
    return last.starts_with("[0,0,0]");
  };
  for (int ms = 0; ms < kPatienceMs && !is_zero(); ++ms) ::usleep(1000);
  EXPECT_TRUE(is_zero()) << last;
}

TEST(LinkFaultTable, HasARowForEachFaultOnEachLink) {
  const std::string page = file_text(PALPATE_SOURCE_ROOT "/docs/results/hands-and-loops.md");
  const std::size_t table = page.find(
      "| fault | libusb, Falcon | hidapi, arm with reports | terminal, arm with text | UDP bridge |");
  ASSERT_NE(table, std::string::npos);
  for (int i = 0; i < kLinkWrongs; ++i) {
    const std::string begins = std::string("\n| ") + link_wrong_name(static_cast<LinkWrong>(i)) + " | ";
    const std::size_t at = page.find(begins, table);
    ASSERT_NE(at, std::string::npos) << begins;
    const std::string row = page.substr(at + 1, page.find('\n', at + 1) - at - 1);
    EXPECT_EQ(std::count(row.begin(), row.end(), '|'), 6) << row;
    EXPECT_EQ(row.find("|  |"), std::string::npos) << "a link without a cell: " << row;
  }
}

}  // namespace

bool measure_hid_faults(int runs, std::string& rows_json) {
  bool right = true;
  {
    PretendedHid bench(kHidName);
    right = measure_link_faults(bench, runs, rows_json) && right;
  }
  {
    TtyBench bench;
    right = measure_link_faults(bench, runs, rows_json) && right;
  }
  UdpBench bench(true);
  return measure_link_faults(bench, runs, rows_json) && right;
}

}  // namespace palpate::device
