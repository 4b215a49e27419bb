"""SemanticKITTI's classes."""

from jaxsim.data.cityscapes import IDS
from jaxsim.data.semantic_kitti import LEARNING_CLASSES, NAME_OF_NUMBER


def test_every_class_of_the_set_is_one_of_cityscapes():
    assert {*NAME_OF_NUMBER.values(), *LEARNING_CLASSES} <= {*IDS}
    assert len(LEARNING_CLASSES) == 20
    # Of what moves the class is that of what stands.
    assert [NAME_OF_NUMBER[252], NAME_OF_NUMBER[254], NAME_OF_NUMBER[258]] == [
        NAME_OF_NUMBER[10],
        NAME_OF_NUMBER[30],
        NAME_OF_NUMBER[18],
    ]
