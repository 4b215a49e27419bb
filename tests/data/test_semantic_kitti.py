"""SemanticKITTI's classes."""

from jaxsim.data.cityscapes import IDS
from jaxsim.data.semantic_kitti import CLASSES, LEARNING_CLASSES


def test_every_class_of_the_set_is_one_of_cityscapes():
    assert {*CLASSES.values(), *LEARNING_CLASSES} <= {*IDS}
    assert len(LEARNING_CLASSES) == 20
    # Of what moves the class is that of what stands.
    assert [CLASSES[252], CLASSES[254], CLASSES[258]] == [CLASSES[10], CLASSES[30], CLASSES[18]]
