// SPDX-License-Identifier: Apache-2.0
#include "procedural/strands/past.h"

#include "procedural/abi/border.h"

#include <algorithm>
#include <span>

namespace marram {

size_t PastSkin::bytes() const {
    size_t sum = pose_of_sample.capacity() * sizeof(uint32_t);
    for (const auto& pose : poses)
        sum += (pose->positions.capacity() + pose->normals.capacity()) * sizeof(float);
    return sum;
}

Surface PastSkin::at(int64_t past_sample, const MarramMesh& mesh) const {
    const Pose& pose = *poses[pose_of_sample[size_t(past_sample - window.first)]];
    return {pose.positions.data(), pose.normals.empty() ? nullptr : pose.normals.data(),
            mesh.triangles,        mesh.uvs,
            mesh.triangle_count,   {}};
}

namespace {

void pose_at(const MarramFrame& frame, uint32_t mesh, double time, PastSkin::Pose& pose) {
    const size_t size = 3 * size_t(frame.meshes[mesh].vertex_count);
    const bool smooth = frame.meshes[mesh].normals != nullptr;
    pose.positions.resize(size);
    pose.normals.resize(smooth ? size : 0);
    pose_lent_mesh(frame, mesh, time, pose.positions.data(), smooth ? pose.normals.data() : nullptr);
}

double farthest(const std::vector<float>& a, const std::vector<float>& b) {
    double most = 0.0;
    for (size_t i = 0; i + 2 < a.size(); i += 3) {
        const double x = double(a[i]) - double(b[i]), y = double(a[i + 1]) - double(b[i + 1]),
                     z = double(a[i + 2]) - double(b[i + 2]);
        most = std::max(most, x * x + y * y + z * z);
    }
    return std::sqrt(most);
}

} // namespace

PastSkin read_past(const MarramFrame& frame, uint32_t mesh, const Jiggle& jiggle, double length,
                   double travel, const PastSkin& earlier, const std::function<void(int64_t)>& announce) {
    PastSkin past;
    const bool moves = has_a_past(frame.meshes[mesh]);
    const std::span times(frame.times, frame.time_count);
    // The window grows with the logarithm of the skin's travel, so a rough estimate is enough.
    PastSkin::Pose now, then;
    pose_at(frame, mesh, times.front(), now);
    for (const double back : {1.0, 4.0, 16.0, 64.0, 256.0}) {
        if (!moves) break;
        pose_at(frame, mesh, times.front() - back, then);
        travel = std::max(travel, farthest(now.positions, then.positions));
    }
    past.window = jiggle_window(jiggle, times, frame.fps, 2.0 * length + travel, frame.tolerance);
    if (past.window.empty()) return past;
    if (moves) check_past_samples(jiggle, double(past.window.count())); // each is posed
    announce(moves ? past.window.count() : past.window.most_samples());
    const auto same = [](const PastSkin::Pose& a, const PastSkin::Pose& b) {
        return a.positions == b.positions && a.normals == b.normals;
    };
    for (int64_t past_sample = past.window.first; past_sample <= past.window.last; ++past_sample) {
        const int64_t before = past_sample - earlier.window.first;
        std::shared_ptr<const PastSkin::Pose> pose;
        if (!moves && !past.poses.empty()) {
            pose = past.poses.back();
        } else if (before >= 0 && size_t(before) < earlier.pose_of_sample.size()) {
            pose = earlier.poses[earlier.pose_of_sample[size_t(before)]];
        } else {
            pose_at(frame, mesh, jiggle.frame_of(past_sample), then);
            pose = std::make_shared<const PastSkin::Pose>(then);
        }
        if (past.poses.empty() || (past.poses.back() != pose && !same(*past.poses.back(), *pose)))
            past.poses.push_back(pose);
        past.pose_of_sample.push_back(uint32_t(past.poses.size() - 1));
    }
    return past;
}

} // namespace marram
