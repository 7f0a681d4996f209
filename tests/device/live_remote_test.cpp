// Requests over the network: what is understood, and that nothing else is.

#include <bit>
#include <limits>

#include "device/live/remote_command.h"
#include "tests/device/helpers.h"
#include "toolkit/core/random.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size);  // tests/fuzz/fuzz_osc.cpp

namespace palpate::device {
namespace {

using Kind = RemoteCommand::Kind;
using Bytes = std::vector<std::uint8_t>;

Bytes padded(std::string text) {
  do {
    text.push_back('\0');
  } while (text.size() % 4 != 0);
  return {text.begin(), text.end()};
}

Bytes operator+(Bytes a, const Bytes& b) {
  a.insert(a.end(), b.begin(), b.end());
  return a;
}

Bytes word(std::uint32_t value) {
  return {static_cast<std::uint8_t>(value >> 24U), static_cast<std::uint8_t>(value >> 16U),
          static_cast<std::uint8_t>(value >> 8U), static_cast<std::uint8_t>(value)};
}

Bytes real(float value) {
  return word(std::bit_cast<std::uint32_t>(value));
}

std::optional<RemoteCommand> asked(const Bytes& bytes) {
  const auto message = read_osc(bytes);
  return message ? command_of(*message) : std::nullopt;
}

TEST(LiveOsc, ReadsAnAddressAndArgumentsOfEachType) {
  // The specification's own example: /foo with i, i, s, f, f.
  const Bytes bytes = padded("/foo") + padded(",iisff") + word(1000) + word(0xFFFFFFFFU) + padded("hello") +
                      real(1.234F) + real(5.678F);
  EXPECT_EQ(bytes.size(), 40u);
  const auto message = read_osc(bytes).value();
  EXPECT_EQ(message.address, "/foo");
  ASSERT_EQ(message.count, 5u);
  EXPECT_EQ(message.arguments[0].integer, 1000);
  EXPECT_EQ(message.arguments[1].integer, -1);
  EXPECT_EQ(message.arguments[2].text, "hello");
  EXPECT_EQ(message.arguments[3].real, 1.234F);
  EXPECT_EQ(message.arguments[4].kind, OscArgument::Kind::kFloat);
}

TEST(LiveOsc, EveryCutAndEveryByteTooManyIsNoMessage) {
  const Bytes whole = padded("/palpate/select") + padded(",si") + padded("cloud-smooth") + word(2);
  ASSERT_TRUE(read_osc(whole));
  for (std::size_t size = 0; size < whole.size(); ++size) {
    // The address alone is a message of an old sender.
    const bool address_alone = size == padded("/palpate/select").size();
    EXPECT_EQ(read_osc(std::span(whole).first(size)).has_value(), address_alone) << size;
  }
  EXPECT_FALSE(read_osc(whole + Bytes{0}));
  EXPECT_FALSE(read_osc(whole + word(0)));
}

TEST(LiveOsc, WhatIsNotOursIsNoMessage) {
  EXPECT_FALSE(read_osc({}));
  EXPECT_FALSE(read_osc(padded("palpate/switch") + padded(","))) << "no slash";
  EXPECT_FALSE(read_osc(padded("#bundle") + word(0) + word(1)));
  EXPECT_FALSE(read_osc(padded("/a") + padded(",b") + word(0))) << "a blob";
  EXPECT_FALSE(read_osc(padded("/a") + padded(",iiiiiiiii") + Bytes(36))) << "nine arguments";
  EXPECT_TRUE(read_osc(padded("/a") + padded(",iiiiiiii") + Bytes(32)));
  EXPECT_FALSE(read_osc(padded("/a") + padded("i") + word(1))) << "types without a comma";
  EXPECT_FALSE(read_osc(Bytes{'/', 'a', 0, 'x'})) << "padding that is not zero";
}

Bytes bundle(const std::vector<Bytes>& elements, std::uint32_t seconds = 0, std::uint32_t fraction = 1) {
  Bytes bytes = padded("#bundle") + word(seconds) + word(fraction);
  for (const Bytes& one : elements) bytes = bytes + word(static_cast<std::uint32_t>(one.size())) + one;
  return bytes;
}

TEST(LiveOsc, ABundleIsItsMessagesInTheirOrderWhateverItsTime) {
  const Bytes next = padded("/palpate/switch"), mark = padded("/palpate/mark") + padded(",s") + padded("a");
  const Bytes two = padded("/palpate/select") + padded(",i") + word(2);
  for (const std::uint32_t seconds : {0U, 0xE0000000U, 0xFFFFFFFFU}) {
    const Bytes bytes = bundle({next, bundle({mark, bundle({})}, seconds), two}, seconds);
    const auto messages = read_osc_packet(bytes).value();
    ASSERT_EQ(messages.size(), 3u);
    EXPECT_EQ(messages[0].address, "/palpate/switch");
    EXPECT_EQ(messages[1].arguments[0].text, "a");
    EXPECT_EQ(messages[2].arguments[0].integer, 2);
  }
  EXPECT_EQ(read_osc_packet(next)->size(), 1u) << "a message by itself";
  EXPECT_TRUE(read_osc_packet(bundle({}))->empty());
}

TEST(LiveOsc, ABundleIsReadWholeOrNotAtAll) {
  const Bytes mark = padded("/palpate/mark");
  const Bytes whole = bundle({mark, bundle({mark})});
  ASSERT_TRUE(read_osc_packet(whole));
  const std::size_t head = bundle({}).size(), first = head + 4 + mark.size();
  for (std::size_t size = 0; size < whole.size(); ++size)
    EXPECT_EQ(read_osc_packet(std::span(whole).first(size)).has_value(), size == head || size == first)
        << size;
  EXPECT_FALSE(read_osc_packet(whole + word(0))) << "an element without bytes";
  EXPECT_FALSE(read_osc_packet(whole + word(4) + Bytes{1, 2, 3, 4})) << "one that is no message";
  EXPECT_FALSE(read_osc_packet(whole + word(0xFFFFFFFFU)));
  EXPECT_FALSE(read_osc_packet(padded("#bundl3") + word(0) + word(1)));
  EXPECT_FALSE(read_osc_packet({}));
  Bytes deep = bundle({mark});
  for (int depth = 1; depth < kMaxOscDepth; ++depth) deep = bundle({deep});
  EXPECT_TRUE(read_osc_packet(deep));
  EXPECT_FALSE(read_osc_packet(bundle({deep}))) << "too deep";
}

TEST(LiveRemote, EachCommandInEachFormThatTabletsSend) {
  const auto is = [](const std::optional<RemoteCommand>& command, Kind kind, int number,
                     const std::string& text) {
    return command && command->kind == kind && command->number == number && command->text == text;
  };
  EXPECT_TRUE(is(asked(padded("/palpate/switch")), Kind::kNext, 0, ""));
  EXPECT_TRUE(is(asked(padded("/palpate/switch") + padded(",f") + real(1.0F)), Kind::kNext, 0, ""));
  EXPECT_TRUE(is(asked(padded("/palpate/switch") + padded(",f") + real(0.0F)), Kind::kNone, 0, ""))
      << "let go";
  EXPECT_TRUE(is(asked(padded("/palpate/cancel") + padded(",")), Kind::kCancel, 0, ""));
  EXPECT_TRUE(is(asked(padded("/palpate/rearm") + padded(",i") + word(1)), Kind::kRearm, 0, ""));
  EXPECT_TRUE(is(asked(padded("/palpate/select") + padded(",i") + word(2)), Kind::kSelect, 2, ""));
  EXPECT_TRUE(is(asked(padded("/palpate/select") + padded(",f") + real(3.0F)), Kind::kSelect, 3, ""));
  EXPECT_TRUE(
      is(asked(padded("/palpate/select") + padded(",s") + padded("cloud")), Kind::kSelect, 0, "cloud"));
  EXPECT_TRUE(is(asked(padded("/palpate/mark") + padded(",s") + padded("here\nit is")), Kind::kMark, 0,
                 "here it is"));
  EXPECT_TRUE(is(asked(padded("/palpate/mark")), Kind::kMark, 0, ""));
}

TEST(LiveRemote, NumbersThatAreNoneSelectNothing) {
  for (const float bad : {0.0F, -1.0F, 1.5F, 1e30F, std::numeric_limits<float>::quiet_NaN(),
                          std::numeric_limits<float>::infinity()})
    EXPECT_FALSE(asked(padded("/palpate/select") + padded(",f") + real(bad))) << bad;
  for (const std::uint32_t bad : {0U, 100U, 0x80000000U, 0xFFFFFFFFU})
    EXPECT_FALSE(asked(padded("/palpate/select") + padded(",i") + word(bad))) << bad;
  EXPECT_FALSE(asked(padded("/palpate/select")));
  EXPECT_FALSE(asked(padded("/palpate/select") + padded(",ii") + word(1) + word(1)));
  EXPECT_FALSE(asked(padded("/palpate/switch") + padded(",s") + padded("now")));
  EXPECT_FALSE(asked(padded("/palpate/explode")));
  EXPECT_FALSE(asked(padded("/other/switch")));
}

TEST(LiveRemote, TextsAreCutAtACharacterAndHoldNoControl) {
  std::string umlauts;
  while (umlauts.size() < 2 * kMaxRemoteText) umlauts += "ü";
  EXPECT_EQ(remote_text(umlauts).size(), kMaxRemoteText);
  EXPECT_EQ(remote_text("x" + umlauts).size(), kMaxRemoteText - 1) << "not half of one";
  EXPECT_EQ(remote_text(std::string("a\0b\x1b[31m", 8)), "a b [31m");
  EXPECT_EQ(remote_text(""), "");
  const std::string later_bytes(2 * kMaxRemoteText, '\x90');
  EXPECT_EQ(remote_text(later_bytes).size(), kMaxRemoteText) << "no UTF-8: cut anywhere, never to nothing";
}

TEST(LiveRemote, TheCorpusAndDamagedMessagesAreAnsweredWithoutHarm) {
  constexpr std::uint64_t kSeed = 11;
  Random random(kSeed);
  int understood = 0;
  const auto corpus = corpus_of(PALPATE_CORPUS "/osc");
  EXPECT_GE(corpus.size(), 14u);
  for (const Bytes& whole : corpus) {
    EXPECT_EQ(LLVMFuzzerTestOneInput(whole.data(), whole.size()), 0);
    for (int i = 0; i < 2000; ++i) {
      Bytes bytes = whole;
      for (std::size_t flips = 1 + random.below(3); flips > 0; --flips)
        bytes[random.below(bytes.size())] ^= static_cast<std::uint8_t>(1U << random.below(8));
      ASSERT_EQ(LLVMFuzzerTestOneInput(bytes.data(), bytes.size()), 0) << "seed " << kSeed;
      if (read_osc_packet(bytes)) ++understood;
    }
  }
  EXPECT_GT(understood, 1000);
}

}  // namespace
}  // namespace palpate::device
