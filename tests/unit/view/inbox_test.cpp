// SPDX-License-Identifier: Apache-2.0
#include "core/view/inbox.h"

#include <gtest/gtest.h>

#include <fmt/format.h>

namespace marram {
namespace {

using Kind = ChangeRequest::Kind;

class InboxTest : public ::testing::Test {
  protected:
    InboxTest() { inbox.join(1), inbox.join(2); }
    bool receive(ViewClient client, const std::string& message) {
        return inbox.receive(client, message, skipped);
    }
    bool frame(ViewClient client, int seq) {
        return receive(client,
                       fmt::format(R"({{"type":"frame","seq":{},"frame":{},"budget":10}})", seq, seq));
    }
    bool picture(ViewClient client, int seq) {
        return receive(client,
                       fmt::format(R"({{"type":"render","seq":{},"frame":1,"camera":{{"position":[0,0,3],)"
                                   R"("target":[0,0,0],"up":[0,1,0],"fov":40}},"size":[64,36],"exposure":0,)"
                                   R"("samples":4}})",
                                   seq));
    }
    Inbox inbox;
    std::vector<uint64_t> skipped;
};

TEST_F(InboxTest, KeepsTheNewestTwoFramesOfAClient) {
    for (int seq = 1; seq <= 5; ++seq) EXPECT_TRUE(frame(1, seq));
    EXPECT_EQ(skipped, (std::vector<uint64_t>{1, 2, 3}));
    EXPECT_EQ(inbox.take_frame()->second.seq, 4U);
    EXPECT_EQ(inbox.take_frame()->second.seq, 5U);
    EXPECT_FALSE(inbox.take_frame());
}

TEST_F(InboxTest, ServesClientsInTurn) {
    for (const ViewClient client : {1, 2})
        for (int seq = 1; seq <= 2; ++seq) frame(client, seq);
    std::vector<ViewClient> served;
    while (const auto next = inbox.take_frame()) served.push_back(next->first);
    EXPECT_EQ(served, (std::vector<ViewClient>{1, 2, 1, 2}));
}

TEST_F(InboxTest, KeepsTheNewestOfChangesOfOneValue) {
    for (int i = 0; i < 1000; ++i)
        EXPECT_TRUE(receive(1, fmt::format(R"({{"type":"set","key":"wind.speed","value":"{}"}})", i)));
    receive(2, R"({"type":"set","key":"wind.calm","value":null})");
    receive(2, R"({"type":"undo"})");
    const std::vector<ChangeRequest> changes = inbox.take_changes();
    ASSERT_EQ(changes.size(), 3U);
    EXPECT_EQ(changes[0].value, "999");
    EXPECT_FALSE(changes[1].value);
    EXPECT_EQ(changes[2].kind, Kind::undo);
    EXPECT_TRUE(inbox.take_changes().empty());
}

TEST_F(InboxTest, PartsOfPicturesLieWithin) {
    const auto part_of = [&](const std::string& crop) {
        receive(1, R"({"type":"stop"})");
        receive(
            1,
            R"({"type":"render","seq":1,"frame":1,"camera":{"position":[0,0,3],"target":[0,0,0],"up":[0,1,0],)"
            R"("fov":40},"size":[64,36],"exposure":0,"samples":4,"crop":)" +
                crop + "}");
        const auto wanted = inbox.picture();
        return wanted ? wanted->second.crop : std::nullopt;
    };
    using Part = std::array<uint32_t, 4>;
    EXPECT_EQ(part_of("[8, 4, 20, 10]"), (Part{8, 4, 20, 10}));
    EXPECT_EQ(part_of("[-8, 90, 1e9, 0]"), (Part{0, 35, 64, 1}));
    EXPECT_FALSE(part_of("[1, 2, 3]"));
    EXPECT_FALSE(part_of(R"(["a", 2, 3, 4])"));
}

TEST_F(InboxTest, DisconnectsWhoFloods) {
    bool good = true;
    for (int i = 0; i < 1000 && good; ++i)
        good = receive(1, fmt::format(R"({{"type":"set","key":"key{}","value":"1"}})", i));
    EXPECT_FALSE(good);
    EXPECT_LE(inbox.take_changes().size(), 32U);
    EXPECT_FALSE(receive(3, R"({"type":"undo"})")); // has never joined
}

TEST_F(InboxTest, PassesOverWhatItDoesNotUnderstand) {
    const std::string valid = R"({"type":"frame","seq":1,"frame":1,"budget":10})";
    for (const std::string& message :
         {std::string(), std::string("{"), std::string("[]"), std::string("null"),
          std::string(R"({"type":7})"), std::string(R"({"type":"frame"})"),
          std::string(R"({"type":"frame","seq":1,"frame":"x","budget":1})"),
          std::string(R"({"type":"frame","seq":1,"frame":1e999,"budget":1})"),
          std::string(R"({"type":"render","seq":1})"), std::string(R"({"type":"set","key":1,"value":"2"})"),
          std::string(R"({"type":"set"})"), std::string(R"({"type":"unknown"})"), std::string("\xff\xfe"),
          std::string(60000, '['),
          std::string(R"({"type":"render","seq":1,"frame":1,"camera":{"position":[0,3,0],"target":[0,0,0],)"
                      R"("up":[0,1,0],"fov":40},"size":[64,36],"exposure":0,"samples":4})")})
        EXPECT_TRUE(receive(1, message)) << message;
    for (size_t length = 0; length < valid.size(); ++length) EXPECT_TRUE(receive(1, valid.substr(0, length)));
    EXPECT_FALSE(inbox.take_frame());
    EXPECT_FALSE(inbox.picture());
    EXPECT_TRUE(inbox.take_changes().empty());
}

TEST_F(InboxTest, StopsPicturesForFramesAndAllForChanges) {
    picture(1, 1);
    ASSERT_TRUE(inbox.picture());
    inbox.begin_picture();
    EXPECT_FALSE(inbox.stop_work());
    frame(2, 1);
    EXPECT_TRUE(inbox.stop_work());
    EXPECT_TRUE(inbox.picture()); // goes on after the frame
    inbox.take_frame();
    inbox.begin_frame(2, 10);
    frame(2, 2);
    EXPECT_FALSE(inbox.stop_work());
    receive(2, R"({"type":"undo"})");
    EXPECT_TRUE(inbox.stop_work());
    inbox.take_changes();
    inbox.begin_picture(); // a frame waits already
    EXPECT_TRUE(inbox.stop_work());
    inbox.take_frame();
    frame(1, 3); // of the client that wants the picture
    EXPECT_FALSE(inbox.picture());
    picture(1, 2);
    receive(1, R"({"type":"stop"})");
    EXPECT_FALSE(inbox.picture());
}

TEST_F(InboxTest, AChangeIsNotStoppedByAnother) {
    inbox.begin_change();
    receive(1, R"({"type":"undo"})");
    frame(2, 1);
    picture(1, 1);
    EXPECT_FALSE(inbox.stop_work());
    inbox.begin_change();
    EXPECT_FALSE(inbox.stop_work());
    inbox.begin_frame(2, 1000);
    EXPECT_TRUE(inbox.stop_work());
}

TEST_F(InboxTest, AFrameOfFewerStrandsStopsOneOfMore) {
    const auto ask = [&](ViewClient client, int budget) {
        receive(client, fmt::format(R"({{"type":"frame","seq":1,"frame":1,"budget":{}}})", budget));
    };
    inbox.begin_frame(1, 1000);
    ask(1, 1000), ask(1, 2000), ask(2, 10);
    EXPECT_FALSE(inbox.stop_work());
    ask(1, 999);
    EXPECT_TRUE(inbox.stop_work());
}

TEST_F(InboxTest, EndsOnlyThePictureThatWasMeant) {
    picture(1, 1);
    picture(1, 2);
    inbox.end_picture(1, 1);
    ASSERT_TRUE(inbox.picture());
    EXPECT_EQ(inbox.picture()->second.seq, 2U);
    inbox.end_pictures();
    EXPECT_FALSE(inbox.picture());
}

TEST_F(InboxTest, TellsWhoCameAndLeft) {
    EXPECT_EQ(inbox.take_new_clients(), (std::vector<ViewClient>{1, 2}));
    EXPECT_TRUE(inbox.take_new_clients().empty());
    frame(1, 1);
    inbox.leave(1);
    EXPECT_EQ(inbox.take_left_clients(), (std::vector<ViewClient>{1}));
    EXPECT_FALSE(inbox.take_frame());
    EXPECT_EQ(inbox.clients(), (std::vector<ViewClient>{2}));
    inbox.end_all();
    inbox.begin_change();
    EXPECT_TRUE(inbox.stop_work());
    inbox.wait(3600.0); // returns at once
}

} // namespace
} // namespace marram
