"""From shots to frames: the pipelines, and what composes and schedules their frames.

The nine stages of a frame, and where each is computed:

1 pose         `pipeline`, `hand.lbs`            vertices and normals of the shot, joint rotations
               `posed_surface`                   the avatar's surface over them, if it has one
2 crop         `pipeline`, `image.crop`          the window that holds the hand, at half size
3 rays         `pipeline`, `field.sampler`       first hits; where each ray is sampled in the shell
4 field        `pipeline`, `field`               density and channels along the ray, composited
5 visibility   `primary_hits`,                   where rays meet the skin, and what reaches them there:
               `light_visibility`                sky, lamps, the hand's own skin, nearby geometry
6 light        `light_visibility`, `light`       direct, indirect diffuse, near field, scattering, reflection
               `measured_light`                  the same as a path tracer has measured it
7 G-buffer     `gbuffer`                         super-resolved coefficients, normal, alpha, depth
               `surface`, `image.shading`     detail, edges, hair; coefficients x light -> linear colour
8 develop      `image.decode`                    scene-linear colour and alpha in the whole image
9 compose      `composition`                     hands against hands and scene, by depth profile

`baked.BakedPipeline` leaves out 5 to 7: its light is in the field. `relightable.RelightablePipeline` takes all, but
keeps the G-buffer while only the light changes. `renderer.Renderer` chooses one of them; `training` takes their stages
with a loss at the end.
"""
