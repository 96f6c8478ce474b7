// SPDX-License-Identifier: Apache-2.0
// The tables that core/scene declares. The declarations are also the manual: `marram info` prints them.
#include "core/scene/description.h"
#include "core/scene/keyed_values.h"

#include <algorithm>
#include <iterator>

namespace marram {
namespace {

using enum ParamType;
constexpr double any = std::numeric_limits<double>::infinity();
// Larger lengths (m) and frames are typing mistakes. Embree silently drops vertices at 1e20.
constexpr double far = 1e8, late = 1e6;
constexpr double bright = 1e9; // products along a path do not overflow a float

std::vector<ParamSpec> global_params() {
    return {
        {"fps", number, "frames/s", "24", 1, 10000, "", "frames a second"},
        {"frames", range, "frames", "[1, 1]", -late, late, "",
         "first and last frame of the shot, whole numbers"},
        {"bind_frame", number, "frames", "none", -late, late, "",
         "frame at which strands are rooted; default: the first of `frames`"},
        {"tolerance", number, "m", "0.001", 0, far, "",
         "error that each approximation may have, for 99 strands in 100, before contact (a strand that "
         "touches "
         "a mesh may pass it on either side); how far a rendered strand may enter a mesh; 0: a thousandth of "
         "each "
         "strand's length, or less"},
        {"tolerance_pixels", number, "pixels", "none", 1e-4, 1e4, "",
         "the same in pixels at camera.target; motion keys and straight pieces follow each strand's own "
         "distance, other settings allow nearer strands more"},
    };
}

std::vector<ParamSpec> camera_params() {
    return {
        {"position", vec3, "m", "", -far, far, "", "where the camera stands"},
        {"target", vec3, "m", "", -far, far, "", "the point that it looks at"},
        {"up", vec3, "", "[0, 1, 0]", -far, far, "", "what is up in the picture; not along the view"},
        keyable({"fov", number, "deg", "40", 0.01, 179, "", "vertical angle of view"}),
        keyable({"lens_radius", number, "m", "0", 0, 1000, "", "radius of the lens; 0: everything is sharp"}),
        keyable({"focus", number, "m", "none", 1e-6, far, "",
                 "distance that is sharp; default: that of the target"}),
        {"transform", keys, "", "{}", -any, any, "",
         "moves position and target: { translate, rotate } or { keys = [{ frame, ... }, ...], interpolation "
         "}, as "
         "of meshes"},
        {"shutter", vec2, "frames", "[0, 0]", -100, 100, "",
         "when the shutter opens and closes, relative to the frame; [-0.25, 0.25] blurs like film, [0, 0] "
         "not at all"},
    };
}

std::vector<ParamSpec> film_params() {
    return {
        {"size", vec2, "pixels", "[640, 360]", 1, 16384, "", "width and height, whole numbers"},
        {"samples", integer, "", "64", 1, 65536, "", "paths a pixel"},
        {"filter", choice, "", "blackman-harris", -any, any, "box|triangle|gaussian|blackman-harris",
         "how samples are weighted around a pixel"},
        {"filter_radius", number, "pixels", "1.5", 0.5, 8, "",
         "radius of the filter; 0.5 with a box is the plain pixel"},
        keyable({"exposure", number, "stops", "0", -32, 32, "",
                 "gain of PNG pictures, 2^exposure; EXR pictures stay linear"}),
        {"max_depth", integer, "", "12", 0, 1024, "",
         "bounces of a path; 0: light sources only, 1: direct light"},
        {"aovs", texts, "", "[]", -any, any, "", "image layers besides the picture"},
        {"noise", number, "", "0", 0, 1, "",
         "stop a pixel once the standard deviation of its mean is below this share of its brightness; "
         "samples is the limit then; 0: off"},
        {"clamp", number, "W/(m^2 sr)", "0", 0, bright, "",
         "largest indirect radiance of a sample, in its greatest channel: removes fireflies, and their light "
         "(its share is printed); 0: off"},
        {"seed", integer, "", "0", 0, 2147483647, "",
         "seed of the noise in the picture; strands do not change"},
        {"motion_keys", integer, "", "none", 2, 64, "",
         "motion samples over the shutter; default: as many as meshes and strands need to stay within the "
         "tolerance"},
        {"geometry", choice, "", "auto", -any, any, "auto|eager|lazy",
         "when strands are made: all before the first ray; or a patch of them when a ray first meets it, "
         "which takes less memory and time where most are not seen, and more where all are; \"auto\": the "
         "latter for grooms that would take 1 GB or more, of which less than half is in view"},
        {"curve_pieces", integer, "", "none", 0, 64, "",
         "straight pieces a segment of round curves and ribbons, 0: cubic; default: the fewest within half "
         "of the tolerance and a quarter of a pixel, cubic if more than 4 are needed"},
    };
}

// Appends the parameters that every mesh has to those of its type.
ItemSchema mesh_type(const char* type, const char* help, std::vector<ParamSpec> params) {
    params.push_back({"material", reference, "", "none", -any, any, "material", "default: a plain grey"});
    params.push_back({"flip", boolean, "", "false", -any, any, "",
                      "turns the mesh over: strands grow and light leaves on the other side"});
    params.push_back(
        {"transform", keys, "", "{}", -any, any, "",
         "{ translate, rotate, scale } or { keys = [{ frame, ... }, ...], interpolation }: scale, then "
         "rotate about x, y, z in degrees, then translate"});
    params.push_back(
        {"instances[].transform", keys, "", "{}", -any, any, "",
         "shows the mesh once more, with all that grows on it: takes it from where it stands to there; as "
         "transform"});
    std::ranges::move(role_params(), std::back_inserter(params));
    params.push_back({"shadow_catcher", boolean, "", "false", -any, any, "",
                      "the camera sees only the shadows on it: black, with the share of light that others "
                      "block as alpha"});
    return {type, help, std::move(params)};
}

std::vector<ItemSchema> mesh_types() {
    return {
        mesh_type(
            "file", "triangles from a file",
            {{"file", file, "", "", -any, any, "numbered",
              "an .obj or .ply file, or a .vdb with a level set; of a mesh that deforms #### is the frame's "
              "number"},
             {"file_frames", range, "frames", "none", -late, late, "",
              "first and last frame that there is a file of: the mesh deforms, straight from frame to frame; "
              "all are read"},
             {"smooth", boolean, "", "true", -any, any, "", "make vertex normals where the file has none"}}),
        mesh_type("plane", "a rectangle in xz around the origin, facing up",
                  {{"size", vec2, "m", "[10, 10]", 1e-6, far, "", "length in x and in z"},
                   {"divisions", integer, "", "1", 1, 4096, "", "squares a side, of two triangles each"}}),
        mesh_type("box", "a box around the origin",
                  {{"size", vec3, "m", "[1, 1, 1]", 1e-6, far, "", "length of its sides"}}),
        mesh_type("sphere", "a sphere around the origin",
                  {{"radius", number, "m", "1", 1e-6, far, "", "radius"},
                   {"divisions", integer, "", "24", 1, 8192, "", "quality: 8 divisions^2 triangles"},
                   {"bumps", number, "m", "0", 0, far, "", "height of smooth bumps; 0: a sphere"},
                   {"frequency", number, "", "8", 0, 1e6, "", "bumps around a great circle, about"}}),
        mesh_type("heightfield", "a plane lifted by an image",
                  {{"image", image, "", "", -any, any, "",
                    "first channel: height; holes that a TIFF declares are filled"},
                   {"size", vec2, "m", "[10, 10]", 1e-6, far, "", "length in x and in z"},
                   {"height", number, "m", "1", -far, far, "", "height where the image is 1"},
                   {"divisions", integer, "", "none", 1, 8192, "", "squares a side; default: one a pixel"}}),
    };
}

std::vector<ItemSchema> curves_types() {
    const ParamSpec closed = {"closed", boolean, "", "false",
                              -any,     any,     "", "join the last point to the first"};
    const ParamSpec prims = {
        "prims",
        texts,
        "",
        "[]",
        -any,
        any,
        "",
        "of a .usda: paths or names of the prims to read, with what is below them, guides, proxies "
        "and invisible ones too; default: all that are meant to be seen"};
    return {
        {"points",
         "a polyline through points",
         {{"points", points, "m", "", -far, far, "", "[[x, y, z], ...], at least 2"}, closed}},
        {"file",
         "the curves of a file",
         {{"file", file, "", "", -any, any, "",
           ".obj with l elements; .ply with edges, a strand_id, or one curve; .usda with BasisCurves"},
          prims,
          closed}},
        {"strands",
         "strands or guides that were groomed elsewhere, with widths, attributes and motion",
         {{"file", file, "", "", -any, any, "numbered",
           ".hair; .usda with BasisCurves; .ply with edges, a strand_id, or one curve; .obj with l "
           "elements; #### is the frame's number"},
          {"file_frames", range, "frames", "none", -late, late, "",
           "first and last frame that there is a file of: strands move straight from frame to frame; all "
           "are read"},
          prims,
          {"cvs_per_strand", integer, "", "none", 2, 1e6, "",
           "of a .ply of points with neither edges nor a strand_id: points of each strand, one strand after "
           "the "
           "other; default: all are one strand"},
          {"reverse", boolean, "", "false", -any, any, "", "the strands of the file run from tip to root"},
          {"transform", keys, "", "{}", -any, any, "", "as of meshes"}}}};
}

} // namespace

std::vector<ParamSpec> role_params() {
    const auto role = [](const char* name, const char* help) {
        return ParamSpec{name, boolean, "", "true", -any, any, "", help};
    };
    return {role("collides", "strands do not enter it"),
            role("shelters", "strands behind it stand in its lee"),
            role("casts_shadows", "light does not pass through it"),
            role("seen_by_camera", "the camera sees it")};
}

Schema scene_schema() {
    Schema schema;
    schema.globals = global_params();
    schema.camera = camera_params();
    schema.film = film_params();
    schema.meshes = mesh_types();
    schema.curves = curves_types();
    return schema;
}

} // namespace marram
